"""Foreseen failures of long computations, such as a lack of memory, as one-line errors."""

import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from col3d.errors import DivergedError, UserError, error_chain

TOO_LARGE = "cannot be converted to type float without overflow"
OUT_OF_MEMORY = ("can't allocate memory", "not enough memory", "CUDA out of memory", "Unable to allocate")
"""Messages of torch and NumPy about a lack of memory, where their errors have no type of their own."""
PEER_GONE = (
    "Connection closed by peer",
    "Connection reset by peer",
    "Broken pipe",
    "Socket Timeout",
    "remote process exited",
    "Timed out waiting",
    "NCCL error",
    "recvValue failed",
    "sendBytes failed",
)
"""Messages of gloo and NCCL when another process of a training is gone."""


@contextmanager
def as_user_errors(smaller: str) -> Iterator[None]:
    """Convert foreseen errors in the block to one line; others keep their traceback.

    Args:
        smaller: what to change if there is too little memory.

    Raises:
        UserError: names the option, and what to do.
    """
    try:
        yield
    except DivergedError as error:
        raise UserError(str(error)) from None
    except Exception as error:
        for hidden in error_chain(error):  # torch raises in any line that runs, even inside a library's try
            if line := _line(hidden, smaller):
                raise UserError(line) from None
        raise


def _line(error: BaseException, smaller: str) -> str:
    last = str(error).strip().splitlines()[-1].strip(" .") if str(error).strip() else ""
    if isinstance(error, RuntimeError) and "DataLoader worker" in str(error):
        return f"data.workers: {last}; the same command goes on"
    if _while_a_worker_spoke(error):
        return f"data.workers: a process that loads frames is gone ({last}); the same command goes on"
    if is_out_of_memory(error):
        return f"memory is out ({_size(error)}); {smaller}"
    if isinstance(error, RuntimeError) and TOO_LARGE in str(error):
        return "optimizer.lr, optimizer.weight_decay: a step of them is beyond what float32 holds; lower them"
    lost = isinstance(error, torch.distributed.DistError) or (
        isinstance(error, RuntimeError) and any(sign in str(error) for sign in PEER_GONE)
    )
    if lost and torch.distributed.is_initialized():
        return "trainer.devices: another process of this training is gone; the same command goes on"
    return ""


def _while_a_worker_spoke(error: BaseException) -> bool:
    """Whether a data loader's worker ended while it transferred data."""
    modules = [str(frame.f_globals.get("__name__")) for frame, _ in traceback.walk_tb(error.__traceback__)]
    in_transfer = bool(modules) and modules[-1].startswith("multiprocessing.")
    return in_transfer and any(module.startswith("torch.utils.data.") for module in modules)


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error means a lack of memory, of a GPU or of the machine."""
    named = isinstance(error, MemoryError | torch.OutOfMemoryError)
    return named or (isinstance(error, RuntimeError) and any(sign in str(error) for sign in OUT_OF_MEMORY))


def _size(error: BaseException) -> str:
    """Return the sentence of a message that says how much memory was requested."""
    sentences = " ".join(str(error).split()).split(". ")
    matching = [sentence for sentence in sentences if "llocate" in sentence]
    return (matching or [type(error).__name__])[0][:160]

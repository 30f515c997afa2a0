"""Environment of programs: the device to compute on, and the warnings of libraries to silence."""

import logging
import warnings

import torch

from col3d.errors import UserError


def quiet() -> None:
    """Silence Lightning's routine messages, including advertisements, and one of its own deprecations."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    logging.getLogger("lightning.fabric").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=r".*isinstance\(treespec, LeafSpec\)")
    warnings.filterwarnings("ignore", message=".*directory .* exists and is not empty")
    warnings.filterwarnings("ignore", message=".*does not have many workers which may be a bottleneck")
    warnings.filterwarnings("ignore", message="ReduceLROnPlateau conditioned on metric")  # no metric yet
    warnings.filterwarnings("ignore", message="The `srun` command is available on your system but is not")


def check_accelerator(name: str) -> None:
    """Refuse an accelerator that this machine does not have.

    Raises:
        UserError: names the option.
    """
    if name in ("gpu", "cuda") and not torch.cuda.is_available():
        raise UserError(f"trainer.accelerator: this machine has no {name}; take auto or cpu")


def device_for(accelerator: str) -> torch.device:
    """Return the device for an option `accelerator`: auto takes a GPU if there is one."""
    on_cpu = accelerator == "cpu" or not torch.cuda.is_available()
    return torch.device("cpu" if on_cpu else "cuda")

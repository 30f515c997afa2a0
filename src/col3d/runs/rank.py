"""Rank of this process among those of a distributed training."""

import os
import threading
import time

import torch
from lightning.pytorch.utilities.rank_zero import rank_zero_only

FIRST = "COL3D_FIRST_PROCESS"
POLL_SECONDS = 1.0


def is_first() -> bool:
    """Whether this process has rank zero and writes files; known from the environment before the Trainer."""
    return getattr(rank_zero_only, "rank", 0) == 0


def wait_for_all() -> None:
    """Wait until all processes of a training have reached this point."""
    if torch.distributed.is_initialized():
        torch.distributed.barrier()


def exit_with_rank_zero() -> None:
    """Make worker processes exit when the first one is gone."""
    if is_first():
        os.environ[FIRST] = str(os.getpid())
    elif FIRST in os.environ:
        threading.Thread(target=_watch, args=(int(os.environ[FIRST]),), daemon=True).start()


def _watch(first: int) -> None:
    while os.getppid() == first:
        time.sleep(POLL_SECONDS)
    os._exit(1)

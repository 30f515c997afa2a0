"""Data loaders whose worker processes ignore signals that are meant for their parent."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from torch.utils.data import DataLoader, Dataset

WORKERS_START = "fork" if sys.platform == "linux" else None
"""Start method, set here because a launcher with processes of its own may have set another one."""
SENT_TO_ALL = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2}
"""Signals that a scheduler or Ctrl-C sends to every process of a job."""


def ignore_worker_signals(worker: int) -> None:
    """Make a worker ignore signals to all processes of a job: only its parent ends it.

    Otherwise the parent would lose its batches before the end of the step, where it can save.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, SENT_TO_ALL)

    def wait() -> None:
        while signal.sigwaitinfo(SENT_TO_ALL).si_pid != os.getppid():
            pass
        os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def signals_held() -> Iterator[None]:
    """Block signals while workers start: they inherit the mask, and none dies before it ignores them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SENT_TO_ALL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class SteadyLoader(DataLoader[Any]):
    """A data loader whose workers are ended by no signal but their parent's."""

    def __init__(self, frames: Dataset[Any], num_workers: int = 0, **options: Any) -> None:
        if num_workers:
            options |= {"multiprocessing_context": WORKERS_START, "worker_init_fn": ignore_worker_signals}
        super().__init__(frames, num_workers=num_workers, **options)

    def __iter__(self) -> Iterator[Any]:  # type: ignore[override]
        with signals_held():
            return super().__iter__()

"""Loaders whose worker processes no signal ends that was meant for their parent."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from torch.utils.data import DataLoader, Dataset

WORKERS_START = "fork" if sys.platform == "linux" else None
"""Said, because a launcher that runs jobs in processes of its own may have set another start method."""


SENT_TO_ALL = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2}
"""Signals that a scheduler or Ctrl-C sends to every process of a job."""


def ignore_worker_signals(worker: int) -> None:
    """Let a worker end when its loader ends it, and not by what is sent to all processes of a job.

    Else its parent would have nothing to go on to the end of the step with, where it can save.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, SENT_TO_ALL)

    def wait() -> None:
        while signal.sigwaitinfo(SENT_TO_ALL).si_pid != os.getppid():
            pass
        os._exit(0)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold back signals while workers start: they inherit it, so that none dies before it can ignore them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SENT_TO_ALL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class SteadyLoader(DataLoader[Any]):
    """A loader whose workers no signal ends but its own."""

    def __init__(self, frames: Dataset[Any], num_workers: int = 0, **options: Any) -> None:
        if num_workers:
            options |= {"multiprocessing_context": WORKERS_START, "worker_init_fn": ignore_worker_signals}
        super().__init__(frames, num_workers=num_workers, **options)

    def __iter__(self) -> Iterator[Any]:  # type: ignore[override]
        with signals_held():
            return super().__iter__()

"""Blocks in which SIGCHLD is ignored, so that the death of a data loader's worker does not interrupt them."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def children_unheard() -> Iterator[None]:
    """Ignore SIGCHLD inside the block, for work that must not be interrupted, such as recording an error.

    Torch turns the death of a loader's worker into an exception wherever the parent process is.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: Any = signal.getsignal(signal.SIGCHLD)
    with suppress(RuntimeError):  # a SIGCHLD that is pending raises here
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)

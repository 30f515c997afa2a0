"""Signals of child processes, which torch turns into errors wherever its parent happens to be."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def children_unheard() -> Iterator[None]:
    """Do what the death of a loader's worker must not interrupt, such as to write down another error."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: Any = signal.getsignal(signal.SIGCHLD)
    with suppress(RuntimeError):  # one that was waiting is heard now
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)

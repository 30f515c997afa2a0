"""Signal handlers for a program's first seconds, while it imports modules: one line and no stack trace."""

import multiprocessing
import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import Any

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143}
LINE = "stopped before anything began; the same command goes on"


def listen() -> None:
    """Let SIGINT and SIGTERM end this process with one line until `over` is called; skip in workers."""
    if multiprocessing.parent_process() or threading.current_thread() is not threading.main_thread():
        return
    for number in CODES:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _end)


def over() -> None:
    """Restore the usual handlers, because the program's work has begun."""
    for number in CODES:
        if signal.getsignal(number) is _end:
            signal.signal(number, usual(number, _end))


def usual(number: int, handler: Any) -> Any:
    """Return the handler to use once work has begun: the given one, or the usual one in place of ours."""
    if handler is not _end:
        return handler
    return signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: an exception would look like a failed import to the module that is being imported."""
    with suppress(Exception):
        sys.stdout.flush()
        os.write(1, f"{LINE}\n".encode("ascii"))
    os._exit(CODES[signal.Signals(number)])

"""Signals in a program's first seconds, while it still imports what it needs: a line and no stack trace."""

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
    """End this process by a line, from now on until `over`; workers stay as they are."""
    if multiprocessing.parent_process() or threading.current_thread() is not threading.main_thread():
        return
    for number in CODES:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _end)


def over() -> None:
    """Let signals do what they do in any program, for something has begun."""
    for number in CODES:
        if signal.getsignal(number) is _end:
            signal.signal(number, usual(number, _end))


def usual(number: int, handler: Any) -> Any:
    """What a handler stands for once something has begun: its own, or else the system's."""
    if handler is not _end:
        return handler
    return signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: an exception would be taken for a failed import by whatever is being imported."""
    with suppress(Exception):
        sys.stdout.flush()
        os.write(1, f"{LINE}\n".encode("ascii"))
    os._exit(CODES[signal.Signals(number)])

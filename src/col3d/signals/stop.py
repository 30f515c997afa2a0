"""Graceful stop on signals: a program ends at a point where no work is lost."""

import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from col3d.signals import startup as early

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1)
INTERRUPTED, PREEMPTED = 130, 143
"""Exit codes after Ctrl-C, and after the signals that job schedulers send."""


class Stopped(SystemExit):
    """A program has stopped because of a signal; `code` is the exit code of the process.

    Attributes:
        signum: the signal.
    """

    def __init__(self, signum: int) -> None:
        super().__init__(INTERRUPTED if signum == signal.SIGINT else PREEMPTED)
        self.signum = signum


class StopSignals:
    """Catches Ctrl-C, SIGTERM, SIGUSR1, SIGHUP unless `nohup` ignores it, and SIGUSR2 if a job's launcher
    handles it.

    A signal raises `Stopped` at once, which ends the process. Between `hold` and `release` it is kept in
    `pending` instead, so that `LastCheckpoint` saves and stops where a training can go on. A second signal
    always raises at once.

    Attributes:
        pending: the signal that came while signals were held back, or None.
    """

    def __init__(self) -> None:
        self.pending: int | None = None
        self._held = False
        self._before: Mapping[int, Any] = {}

    def __enter__(self) -> "StopSignals":
        listened = [signal.SIGUSR2] if callable(signal.getsignal(signal.SIGUSR2)) else []  # submitit's
        self._before = {n: early.usual(n, signal.getsignal(n)) for n in (*SIGNALS, *listened)}
        if self._before[signal.SIGHUP] is signal.SIG_IGN:
            del self._before[signal.SIGHUP]
        self._listen()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if _in_main_thread():
            for number, handler in self._before.items():
                signal.signal(number, handler)

    def hold(self) -> None:
        """Keep signals in `pending` from now on, including those that Lightning's Trainer handles."""
        self._held = True
        self._listen()

    def release(self) -> None:
        """Let signals end the process at once again.

        Raises:
            Stopped: a signal is pending.
        """
        self._held = False
        self._listen()
        if self.pending is not None:
            raise Stopped(self.pending)

    def hand_on(self, signum: int) -> None:
        """Call the handler that was set before: submitit's puts its job back into the queue."""
        handler = self._before.get(signum)
        if callable(handler) and handler is not signal.default_int_handler:
            handler(signum, None)

    def _listen(self) -> None:
        if _in_main_thread():  # only the main thread may set handlers
            for number in self._before:
                signal.signal(number, self._receive)

    def _receive(self, signum: int, frame: FrameType | None) -> None:
        if not self._held or self.pending is not None:
            raise Stopped(signum)
        self.pending = signum


@contextmanager
def stoppable(how: str) -> Iterator[StopSignals]:
    """Let Ctrl-C, SIGTERM, SIGHUP or SIGUSR1 end the block, and close everything that is open in it.

    A signal raises `Stopped` at once. After `hold` it is kept in `pending`, which the block may read, and
    raises at the end of the block. A second signal never waits.

    Args:
        how: how to go on, printed after a stop.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after the others.
    """
    with StopSignals() as stop:
        try:
            yield stop
            stop.release()
        except Stopped as stopped:
            print(f"\nstopped; {how}", flush=True)  # a signal may come in the middle of a line
            raise SystemExit(stopped.code) from None


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()

"""Signals that ask a program to end, granted where nothing is lost by it."""

import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from col3d.signals import startup as early

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1)
INTERRUPTED, PREEMPTED = 130, 143
"""Exit codes after Ctrl-C, and after the signals that schedulers send."""


class Stopped(SystemExit):
    """A training that was asked to stop has done so; its `code` is the exit code of the process.

    Attributes:
        signum: the signal that asked for it.
    """

    def __init__(self, signum: int) -> None:
        super().__init__(INTERRUPTED if signum == signal.SIGINT else PREEMPTED)
        self.signum = signum


class StopSignals:
    """Catches Ctrl-C, SIGTERM, SIGUSR1, SIGHUP where `nohup` has not turned it off, and SIGUSR2 where the
    launcher of a job listens to it.

    A signal ends the process at once, by `Stopped`, but for the time of a training: there it is kept in
    `asked`, for `LastCheckpoint` to save and stop where a training can go on. A second signal does not wait.

    Attributes:
        asked: the signal that came while it was held back.
    """

    def __init__(self) -> None:
        self.asked: int | None = None
        self._held = False
        self._before: Mapping[int, Any] = {}

    def __enter__(self) -> "StopSignals":
        listened = [signal.SIGUSR2] if callable(signal.getsignal(signal.SIGUSR2)) else []  # submitit does
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
        """Keep signals in `asked` from now on, those too that Lightning's Trainer took for itself."""
        self._held = True
        self._listen()

    def release(self) -> None:
        """Let signals end the process at once again, and one that came too late to be granted now."""
        self._held = False
        self._listen()
        if self.asked is not None:
            raise Stopped(self.asked)

    def hand_on(self, signum: int) -> None:
        """Call who listened to the signal before: submitit's handler puts its job back into the queue."""
        handler = self._before.get(signum)
        if callable(handler) and handler is not signal.default_int_handler:
            handler(signum, None)

    def _listen(self) -> None:
        if _in_main_thread():  # the only one that may
            for number in self._before:
                signal.signal(number, self._receive)

    def _receive(self, signum: int, frame: FrameType | None) -> None:
        if not self._held or self.asked is not None:
            raise Stopped(signum)
        self.asked = signum


@contextmanager
def stoppable(how: str) -> Iterator[StopSignals]:
    """End the block by Ctrl-C, SIGTERM, SIGHUP or SIGUSR1 with everything closed that is open in it.

    A signal raises `Stopped` at once; after `hold` it waits in `asked` for the block to look at it, and is
    granted at the end. A second signal never waits.

    Args:
        how: to go on, said on screen.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after the others.
    """
    with StopSignals() as stop:
        try:
            yield stop
            stop.release()
        except Stopped as stopped:
            print(f"\nstopped; {how}", flush=True)  # on a line of its own: a signal may come amid another
            raise SystemExit(stopped.code) from None


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()

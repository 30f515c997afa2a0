"""`train.py` in a process of its own."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

PROJECT = Path(__file__).parents[2]
LONGEST = 300.0
"""Seconds that a training may take, with whatever it waits for."""
POLL = 0.001


class NotMadeError(Exception):
    """A fault cannot be made on this machine."""


class LostError(Exception):
    """What was waited for did not come."""


class Training:
    """`train.py` in a process group of its own.

    Args:
        arguments: of the command line.
        log: where it prints.
        environment: what differs from this program's.
        before: a command that starts it.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        log: Path,
        environment: Mapping[str, str] | None = None,
        before: Sequence[str] = (),
    ) -> None:
        self.log, self.start = log, time.monotonic()
        with log.open("w") as out:
            self.process = subprocess.Popen(
                [*before, sys.executable, str(PROJECT / "train.py"), *arguments],
                cwd=log.parent,
                env={**os.environ, "OMP_NUM_THREADS": "1", **(environment or {})},
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        """All that it has printed."""
        return self.log.read_text(errors="replace")

    def until(self, happened: Callable[[], bool]) -> None:
        """Wait for an event.

        Raises:
            LostError: the training ended before it.
        """
        while not happened():
            if self.process.poll() is not None or time.monotonic() - self.start > LONGEST:
                self.close()
                raise LostError(f"the event never came: {self.said[-2000:]}")
            time.sleep(POLL)

    def workers(self) -> list[int]:
        """Processes that load its data."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(number) for number in path.read_text().split()]

    def send(self, signum: int, group: bool = False) -> None:
        """A signal to the process, or to its workers, too, as a terminal and a scheduler do."""
        (os.killpg if group else os.kill)(self.process.pid, signum)

    def end(self) -> int:
        """Its exit code, negative where a signal killed it."""
        try:
            return self.process.wait(max(1.0, LONGEST - time.monotonic() + self.start))
        except subprocess.TimeoutExpired:
            raise LostError(f"it hangs: {self.said[-2000:]}") from None
        finally:
            self.close()

    def close(self) -> None:
        """Leave no process behind."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

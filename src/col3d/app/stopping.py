"""Programs that are asked to stop: they leave what is whole, say how to go on, and end with its code."""

from collections.abc import Iterator
from contextlib import contextmanager

from col3d.callbacks import Stopped, StopSignals


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
            print(f"stopped; {how}", flush=True)
            raise SystemExit(stopped.code) from None

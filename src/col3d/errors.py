"""Exceptions, whose messages name the argument, the rule and the value; faults of disks."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

DISK_FAULTS = (errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.ENXIO)
"""Error numbers that are faults of the disk or server and not of the file that was read."""


class About:
    """Mixin of the project's exceptions: what the message is about, for code that does not read prose."""

    @property
    def about(self) -> str:
        """The option, argument, file or folder that the message begins with; empty if it begins with none."""
        head, colon, _ = str(self).partition("\n")[0].partition(": ")
        return head if colon else ""


class DataError(About, ValueError):
    """A file or folder of a data set breaks a rule; the message names it and says what to do."""


class DiskError(DataError):
    """A file could not be read because of the disk or the server, whatever its content is."""


class OptionError(About, ValueError):
    """An option breaks a rule; the message begins with its name."""


class UserError(About, Exception):
    """An error that the user has to fix; programs print its message without a traceback."""


class RunLockedError(UserError):
    """Another process is training in the folder of this run."""


class DivergedError(About, RuntimeError):
    """A loss or a gradient became NaN or infinite."""


def check_disk(path: Path, error: Exception) -> None:
    """Raise `DiskError` if an error is a fault of the disk and not of the file.

    Raises:
        DiskError: names the file.
    """
    if isinstance(error, OSError) and error.errno in DISK_FAULTS:
        raise DiskError(f"{path}: cannot be read ({error.strerror})") from None


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let operating system errors in the block name a file: the error of a full disk names none.

    Raises:
        OSError: names `path`.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:  # otherwise the message is complete
            error.filename = str(path)
        raise


def error_chain(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and its chained causes and contexts, the newest first."""
    current: BaseException | None = error
    while current is not None:
        yield current
        current = current.__cause__ or current.__context__

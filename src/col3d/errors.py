"""Errors that name the argument, the rule and what came."""

import difflib
import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

DISK_FAULTS = (errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.ENXIO)
"""Numbers of errors that say nothing of the file that was read."""


class DataError(ValueError):
    """A file or folder of a data set breaks a rule; the message names it and says what to do."""


class DiskError(DataError):
    """A file could not be read for the disk's or the server's sake, whatever is in it."""


class OptionError(ValueError):
    """An option breaks a rule; the message begins with its name."""


class UserError(Exception):
    """Something that the caller has to change; the text is all there is to show."""


class RunLockedError(UserError):
    """Another process is at this run already."""


class DivergedError(RuntimeError):
    """A loss or a gradient became NaN or infinite."""


def check_disk(path: Path, error: Exception) -> None:
    """Tell a disk that fails from a file that is broken.

    Raises:
        DiskError: names the file, where it is the disk.
    """
    if isinstance(error, OSError) and error.errno in DISK_FAULTS:
        raise DiskError(f"{path}: cannot be read ({error.strerror})") from None


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let errors of the disk in the block name a file: a full one does not say of what.

    Raises:
        OSError: names `path`.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:  # else its text says it all
            error.filename = str(path)
        raise


def and_beneath(error: BaseException) -> Iterator[BaseException]:
    """An error and those that it was raised over, the newest first."""
    found: BaseException | None = error
    while found is not None:
        yield found
        found = found.__cause__ or found.__context__


def nearest_name(name: str, known: Iterable[str]) -> str:
    """A hint such as `; did you mean 'bts'?`, or nothing where no known name is close."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def check_known(argument: str, name: str, known: Iterable[str]) -> str:
    """Return `name` where it is one of `known`.

    Raises:
        OptionError: names the argument, what came, the nearest valid name and all valid names.
    """
    known = list(known)
    if name in known:
        return name
    raise OptionError(
        f"{argument}: {name!r} is unknown{nearest_name(name, known)}; known: {', '.join(known)}"
    )

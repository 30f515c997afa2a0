"""Fetch several archives at a time by threads, each of which unpacks and checks its own."""

import fcntl
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from threading import Lock, Thread

from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from col3d.data.download import (
    Interrupted,
    Server,
    fetch,
    mismatch,
    unpack,
)
from col3d.data.download.options import DownloadOptions
from col3d.data.download.plan import (
    Part,
)
from col3d.errors import DataError, RunLockedError, UserError
from col3d.io.ownership import Owned

SETTLE = 5.0
"""Seconds that threads have to end after a signal."""


class Team:
    """Threads that each take a video, fetch and unpack it, and take the next.

    Args:
        parts: the videos to fetch.
        options: number of threads, and whether archives are kept.
        server: the server of the archives.
        owned: files of this program in the root.
    """

    def __init__(self, parts: Sequence[Part], options: DownloadOptions, server: Server, owned: Owned) -> None:
        self.parts, self.options, self.server, self.owned = parts, options, server, owned
        self.todo: SimpleQueue[Part] = SimpleQueue()
        self.ended: SimpleQueue[tuple[Part | None, Exception | None]] = SimpleQueue()
        self.done = dict.fromkeys((part.video for part in parts), 0)
        self.lock = Lock()
        columns = (BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
        self.bar = Progress(TextColumn("download"), *columns)
        self.task = self.bar.add_task("download", total=sum(part.file.size for part in parts))

    def work(self) -> list[str]:
        """Fetch all videos; returns a line for each one that could not be fetched.

        Raises:
            OSError: the disk is full, or the like; the remaining videos are not fetched either.
        """
        for part in self.parts:
            self.todo.put(part)
        # Daemons: a read that hangs in the network does not keep the process alive after a signal.
        threads = [Thread(target=self._serve, daemon=True) for _ in range(self.options.parallel)]
        try:
            with self.bar:
                for thread in threads:
                    thread.start()
                return self._wait(len(threads))
        finally:
            self.server.stop.set()
            for thread in threads:
                thread.join(SETTLE)

    def _wait(self, working: int) -> list[str]:
        failures = []
        while working:
            part, error = self.ended.get()
            if part is None:
                working -= 1
            elif isinstance(error, DataError | UserError):
                failures.append(str(error))
            elif error is not None:
                raise error
            else:
                self.bar.console.print(f"{part.folder}: there", markup=False, highlight=False, soft_wrap=True)
        return failures

    def _serve(self) -> None:
        try:
            while not self.server.stop.is_set():
                part = self.todo.get_nowait()
                error: Exception | None = None
                try:
                    self._one(part)
                except Interrupted:
                    return
                except Exception as caught:  # the main thread raises it
                    error = caught
                self.ended.put((part, error))
        except Empty:
            pass
        finally:
            self.ended.put((None, None))

    def _one(self, part: Part) -> None:
        archive, *others = part.names
        with self.lock:
            ours = archive in self.owned.names or not part.archive.exists()
            self.owned.claim(*others, *([archive] if ours else []))
        if part.archive.exists():
            wrong = mismatch(part.file, part.archive, self.server.stop)
            if wrong and not ours:
                raise UserError(
                    f"data.root: {part.archive} is of no download of this program, and {wrong}; move it"
                )
            if wrong:
                part.archive.unlink()
        if not part.archive.exists():
            fetch(self.server, part.file, part.archive, lambda done: self._progress(part, done))
        self._progress(part, part.file.size)
        if part.folder.is_dir():
            part.folder.rmdir()  # it was empty when it was checked
        try:
            unpack(part.archive, part.folder, part.unpacking, self.server.stop)
        except DataError:
            if ours and not part.file.hashed_by:  # the server may have sent another file
                part.archive.unlink()
            raise
        if ours and not self.options.keep:
            part.archive.unlink()

    def _progress(self, part: Part, done: int) -> None:
        self.done[part.video] = done
        self.bar.update(self.task, completed=sum(self.done.values()))


@contextmanager
def locked_folder(owned: Owned) -> Iterator[None]:
    """Lock the list of our files against another download into its folder.

    Raises:
        RunLockedError: another download is running.
    """
    root = owned.folder
    descriptor = os.open(owned.list, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # not lockf: the list is opened, too
        except BlockingIOError:
            raise RunLockedError(f"data.root: another process downloads into {root}") from None
        except OSError as error:
            print(f"note: {root} cannot be locked ({error.strerror}): download into it once", flush=True)
        yield
    finally:
        os.close(descriptor)

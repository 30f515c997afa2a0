"""Fetch videos of C3VD or C3VDv2: options -> a list -> archives -> folders that are checked."""

import fcntl
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Lock, Thread
from typing import Any

from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from col3d.data.datasets.videos import catalogue, frames_of
from col3d.data.download import (
    LICENCE,
    Interrupted,
    Listing,
    Server,
    chosen,
    fetch,
    list_files,
    mismatch,
    unpack,
    unpacked_size,
)
from col3d.data.download.options import DownloadOptions
from col3d.data.download.plan import (
    GB,
    Part,
    check_places,
    check_space,
    folders_there,
    named_videos,
)
from col3d.errors import DataError, RunLockedError, UserError
from col3d.io.ownership import Owned
from col3d.registry import DATASETS
from col3d.registry.refusals import check_options
from col3d.signals import stoppable

FAULTY = 1
SETTLE = 5.0
"""Seconds that threads have to end in after a signal."""
LISTED = 40


def download(given: Mapping[str, Any]) -> None:
    """List, fetch, unpack and check videos; exit with 1 where one that is there is not whole.

    Raises:
        UserError: an option breaks a rule, the licence is not accepted, or the disk is too small.
        DataError: the server does not give a video, or gives another than it says.
    """
    options = check_options(DownloadOptions, given)
    videos = named_videos(options)
    with stoppable(f"what was fetched stays in {options.data.root}, and the same command goes on there"):
        faults = _download(options, videos)
    if faults:
        sys.exit(FAULTY)


def _download(options: DownloadOptions, videos: Sequence[str]) -> int:
    """The number of videos that are not whole at the end."""
    there = folders_there(options)
    stop = Event()
    server = Server(options.server, options.timeout, options.attempts, stop=stop)
    parts: list[Part] = []
    if missing := [video for video in videos if video not in there]:
        listing = list_files(server, options.doi)
        root = Path(options.data.root)
        parts = [Part(video, file, root) for video, file in chosen(listing, missing).items()]
        _print_list(parts, listing, len(videos) - len(parts))
        _check_licence(options, listing)
    if parts:
        _fetch_all(parts, options, server)
    return _check_all(videos, options)


def _print_list(parts: Sequence[Part], listing: Listing, there: int) -> None:
    """What there is to fetch, how large it is, and under which licence."""
    for part in parts[:LISTED]:
        done = f", {part.done / GB:.2f} GB of it there" if part.done else ""
        frames = frames_of(part.video)
        print(f"{part.video:24} {part.file.name:32} {frames:6} frames {part.file.size / GB:8.2f} GB{done}")
    if len(parts) > LISTED:
        print(f"... and {len(parts) - LISTED} more")
    total = sum(part.file.size for part in parts)
    known = f"; {there} are there and stay as they are" if there else ""
    print(f"{len(parts)} videos, {total / GB:.2f} GB{known}")
    print(f"licence: {_licence(listing)}", flush=True)


def _licence(listing: Listing) -> str:
    server = f"; the server says {listing.licence}" if listing.licence not in ("", LICENCE) else ""
    return f"{LICENCE} (attribution, no commercial use, share alike), (c) Johns Hopkins University{server}"


def _check_licence(options: DownloadOptions, listing: Listing) -> None:
    if not options.accept_licence:
        raise UserError(
            f"accept_licence: they are under {LICENCE}; to keep to it and fetch, give accept_licence=true"
        )


def _fetch_all(parts: Sequence[Part], options: DownloadOptions, server: Server) -> None:
    """Fetch and unpack, a few videos at a time.

    Raises:
        UserError: some were not to be had, a line for each; the others are there.
    """
    root = Path(options.data.root)
    owned = Owned(root, "download", "data.root")
    check_places(parts, owned)
    print(check_space(parts, _unpacked_sizes(parts, options, server), options), flush=True)
    root.mkdir(parents=True, exist_ok=True)
    with _locked(owned):
        failures = _Team(parts, options, server, owned).work()
    if failures:
        raise UserError("\n".join(failures))


def _unpacked_sizes(parts: Sequence[Part], options: DownloadOptions, server: Server) -> dict[str, int | None]:
    """Bytes that each video takes, by its name; None where the server does not tell."""
    with ThreadPoolExecutor(options.parallel * 2) as pool:
        try:
            sizes = list(pool.map(lambda part: unpacked_size(server, part.file), parts))
        except BaseException:  # a signal: those that wait for a thread are to end at once
            server.stop.set()
            raise
    return {part.video: size for part, size in zip(parts, sizes, strict=True)}


class _Team:
    """Threads that each take a video, fetch and unpack it, and take the next.

    Args:
        parts: the videos.
        options: how many at a time, and whether archives stay.
        server: that has them.
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
        """Fetch all; a line for each video that was not to be had.

        Raises:
            OSError: the disk is full, or something of the kind; the others are left, too.
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
                except Exception as caught:  # which the main thread raises
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
            fetch(self.server, part.file, part.archive, lambda done: self._told(part, done))
        self._told(part, part.file.size)
        if part.folder.is_dir():
            part.folder.rmdir()  # which was empty when it was looked at
        try:
            unpack(part.archive, part.folder, part.unpacking, self.server.stop)
        except DataError:
            if ours and not part.file.hashed_by:  # it may be another that was sent
                part.archive.unlink()
            raise
        if ours and not self.options.keep:
            part.archive.unlink()

    def _told(self, part: Part, done: int) -> None:
        self.done[part.video] = done
        self.bar.update(self.task, completed=sum(self.done.values()))


@contextmanager
def _locked(owned: Owned) -> Iterator[None]:
    """Hold the list of what is ours against another download into its folder.

    Raises:
        RunLockedError: there is one.
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


def _check_all(videos: Sequence[str], options: DownloadOptions) -> int:
    """Look at headers, lengths and numbers of all files of the videos; how many are not whole."""
    faults = 0
    for video in videos:
        try:
            print(f"{video}: {_checked(video, options)}", flush=True)
        except DataError as error:
            faults += 1
            print(f"fault: {error}", flush=True)
    root = options.data.root
    print(
        f"{len(videos) - faults} of {len(videos)} videos are whole; "
        f"col3d verify data={options.data.name} data.root={root} reads every file to its end",
        flush=True,
    )
    return faults


def _checked(video: str, options: DownloadOptions) -> str:
    """How much there is of a video.

    Raises:
        DataError: a file is missing or broken, or frames are.
    """
    row = catalogue()[video]
    kind, root = DATASETS[options.data.name].build, options.data.root
    frames = kind(root, [video], normals="stored" if row.has_truth else "none", truth=row.has_truth)
    wanted = {frames_of(video, release) for release in frames.releases.values()} or {row.frames}
    if len(frames) not in wanted:
        raise DataError(f"{frames.folders[video]}: expected {row.frames} frames, got {len(frames)}")
    poses = len(frames.poses(video))
    return f"{len(frames)} frames, {poses} poses"

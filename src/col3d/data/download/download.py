"""Fetch videos of C3VD or C3VDv2: options -> a list -> archives -> folders that are checked."""

import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

from col3d.data.datasets.videos import catalogue, frames_of
from col3d.data.download import (
    LICENCE,
    Listing,
    Server,
    chosen,
    list_files,
    unpacked_size,
)
from col3d.data.download.options import DownloadOptions
from col3d.data.download.plan import (
    GB,
    Part,
    check_places,
    check_space,
    existing_folders,
    named_videos,
)
from col3d.data.download.team import Team, locked_folder
from col3d.errors import DataError, UserError
from col3d.io.ownership import Owned
from col3d.registry import DATASETS
from col3d.registry.refusals import check_options
from col3d.signals import stoppable

FAULTY = 1
LISTED = 40


def download(given: Mapping[str, Any]) -> None:
    """List, fetch, unpack and check videos; exit with 1 where an existing one is not complete.

    Raises:
        UserError: an option breaks a rule, the licence is not accepted, or the disk is too small.
        DataError: the server does not send a video, or its checksum is wrong.
    """
    options = check_options(DownloadOptions, given)
    videos = named_videos(options)
    with stoppable(f"what was fetched stays in {options.data.root}, and the same command goes on there"):
        faults = _download(options, videos)
    if faults:
        sys.exit(FAULTY)


def _download(options: DownloadOptions, videos: Sequence[str]) -> int:
    """Fetch and check; returns the number of videos that are not complete."""
    existing = existing_folders(options)
    stop = Event()
    server = Server(options.server, options.timeout, options.attempts, stop=stop)
    parts: list[Part] = []
    if missing := [video for video in videos if video not in existing]:
        listing = list_files(server, options.doi)
        root = Path(options.data.root)
        parts = [Part(video, file, root) for video, file in chosen(listing, missing).items()]
        _print_list(parts, listing, len(videos) - len(parts))
        _check_licence(options, listing)
    if parts:
        _fetch_all(parts, options, server)
    return _check_all(videos, options)


def _print_list(parts: Sequence[Part], listing: Listing, existing: int) -> None:
    """Print the videos to fetch, their sizes, and the licence."""
    for part in parts[:LISTED]:
        done = f", {part.done / GB:.2f} GB of it there" if part.done else ""
        frames = frames_of(part.video)
        print(f"{part.video:24} {part.file.name:32} {frames:6} frames {part.file.size / GB:8.2f} GB{done}")
    if len(parts) > LISTED:
        print(f"... and {len(parts) - LISTED} more")
    total = sum(part.file.size for part in parts)
    known = f"; {existing} are there and stay as they are" if existing else ""
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
        UserError: some could not be fetched, a line for each; the others are complete.
    """
    root = Path(options.data.root)
    owned = Owned(root, "download", "data.root")
    check_places(parts, owned)
    print(check_space(parts, _unpacked_sizes(parts, options, server), options), flush=True)
    root.mkdir(parents=True, exist_ok=True)
    with locked_folder(owned):
        failures = Team(parts, options, server, owned).work()
    if failures:
        raise UserError("\n".join(failures))


def _unpacked_sizes(parts: Sequence[Part], options: DownloadOptions, server: Server) -> dict[str, int | None]:
    """Unpacked bytes of each video, by its name; None where the server does not tell."""
    with ThreadPoolExecutor(options.parallel * 2) as pool:
        try:
            sizes = list(pool.map(lambda part: unpacked_size(server, part.file), parts))
        except BaseException:  # a signal: queued requests have to end at once
            server.stop.set()
            raise
    return {part.video: size for part, size in zip(parts, sizes, strict=True)}


def _check_all(videos: Sequence[str], options: DownloadOptions) -> int:
    """Check headers, lengths and numbers of all files of the videos; returns how many are incomplete."""
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
    """Line on the frames and poses of a video, whose files are checked.

    Raises:
        DataError: a file is missing or broken, or frames are missing.
    """
    row = catalogue()[video]
    kind, root = DATASETS[options.data.name].build, options.data.root
    frames = kind(root, [video], normals="stored" if row.has_truth else "none", truth=row.has_truth)
    wanted = {frames_of(video, release) for release in frames.releases.values()} or {row.frames}
    if len(frames) not in wanted:
        raise DataError(f"{frames.folders[video]}: expected {row.frames} frames, got {len(frames)}")
    poses = len(frames.poses(video))
    return f"{len(frames)} frames, {poses} poses"

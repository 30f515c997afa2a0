"""Make data ready for training: render the phantom, and prepare the frames of any data set at one size."""

import errno
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from col3d.data.build import frame_set, other_folder_names
from col3d.data.cache import Recipe, folder_of, read_video, write_video
from col3d.data.cache.choice import beside, recipe_of, remember
from col3d.data.cache.codes import shapes
from col3d.data.cache.options import PrepareOptions
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.datasets.videos import seeded_name, video_table
from col3d.data.options import SourceOptions
from col3d.data.processes import in_processes
from col3d.data.rendered import is_rendered, phantom_settings, render_missing
from col3d.data.sized import Resized
from col3d.data.splits import SPLITS, expand, parse_selection
from col3d.data.whole_folder import check_replaceable, remove_stale
from col3d.errors import DataError, UserError
from col3d.phantom.options import PhantomOptions
from col3d.registry.refusals import check_options
from col3d.signals import stoppable

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def prepare(given: Mapping[str, Any]) -> None:
    """Render missing videos of the phantom, then prepare every video that is not prepared yet.

    Raises:
        UserError: an option breaks a rule, a file is not what it should be, or the disk is full.
    """
    options = check_options(PrepareOptions, given)
    source, size_hw = options.data, (options.data.size[0], options.data.size[1])
    with stoppable("finished videos stay, and the same command goes on"):
        if is_rendered(source):
            settings = phantom_settings(source, options.phantom, _videos_of(source))
            render_missing(Path(source.root), settings, options.workers)
            print(f"phantom ready: {source.root}, {len(settings.videos)} videos", flush=True)
        frames = frame_set(source, options.phantom, [])
        recipe = recipe_of(source, frames, size_hw)
        store = beside(source.root, size_hw) if options.prepare.out is None else Path(options.prepare.out)
        _prepare(store.absolute(), source, options.phantom, frames, recipe, options.workers)


def _videos_of(source: SourceOptions) -> list[str] | None:
    """Videos of the split where it names phantoms of other seeds; else None, which is all of C3VD's."""
    entries = [entry for part in SPLITS for entry in getattr(source.split, part)]
    named = sorted({parse_selection(entry).video for entry in expand(entries, list(video_table()))})
    return named if any(seeded_name(video, 0)[0] != video for video in named) else None


def _prepare(
    store: Path,
    source: SourceOptions,
    phantom: PhantomOptions,
    frames: FrameSet,
    recipe: Recipe,
    workers: int | None,
) -> None:
    if names := other_folder_names(frames):
        print(names, flush=True)
    counts = {}
    for video, folder in frames.folders.items():
        if reason := frames.refusal(video):
            print(f"note: left out: {reason}", flush=True)
        elif count := len(frames.files(folder, ["color"])["color"]):
            counts[video] = count
    for note in frames.notes.values():
        print(f"note: {note}", flush=True)
    if not counts:
        raise UserError(f"data.root={source.root}: {frames.without_frames()}")
    _check_place(store, Path(source.root), recipe, list(counts))
    remove_stale(store)
    missing = [video for video in counts if not _is_prepared(store, frames, video, recipe)]
    for video in missing:
        check_replaceable(folder_of(store, video))
    _check_space(store, recipe, sum(counts[video] for video in missing))
    jobs = [(store, source, phantom, video, recipe) for video in missing]
    total = sum(counts[video] for video in missing)
    try:
        faults = in_processes(prepare_video, jobs, "prepare", total, workers)
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        raise UserError(
            f"prepare.out={store}: the disk is full ({_gigabytes(shutil.disk_usage(store).free)} left); "
            "free some and run the same command: finished videos stay"
        ) from None
    if faults := [fault for fault in faults if fault]:
        raise UserError("\n".join(faults))
    _report(store, Path(source.root), source, counts, len(missing), recipe)


def prepare_video(
    store: Path,
    source: SourceOptions,
    phantom: PhantomOptions,
    video: str,
    recipe: Recipe,
    frame_done: Callable[[], None],
) -> str:
    """Prepare one video; returns what is wrong with its files, or an empty text."""
    torch.set_num_threads(1)
    try:
        frames = frame_set(source, phantom, [video])
        write_video(store, Resized(frames, recipe.size_hw), recipe, frame_done)
    except DataError as error:
        return str(error)
    return ""


def _is_prepared(store: Path, frames: FrameSet, video: str, recipe: Recipe) -> bool:
    """Whether the store holds the video with the files that are on disk now."""
    stored = read_video(folder_of(store, video))
    if stored is None or stored.video != video:
        return False
    try:
        stored.check()
        current = frames.find(video)
    except DataError:
        return False
    return not stored.stale(frames.root, current) and len(current) == len(stored.frames)


def _check_place(store: Path, root: Path, recipe: Recipe, videos: Sequence[str]) -> None:
    """Refuse a store that holds anything but prepared videos of this recipe."""
    if store.exists() and not store.is_dir():
        raise UserError(f"prepare.out={store}: expected a folder, got a file")
    if store.resolve() == root.resolve():
        raise UserError(f"prepare.out={store}: is data.root itself; choose another folder")
    for folder in sorted(store.glob("[!.]*")):
        video = read_video(folder) if folder.is_dir() else None
        if video is None:
            raise UserError(
                f"prepare.out={store}: {folder.name} is no prepared video and stays untouched; "
                "choose another folder"
            )
        if differs := video.differs(recipe):
            raise UserError(
                f"prepare.out={store}: {folder.name} was prepared otherwise ({differs}); choose another "
                "folder or delete this one"
            )
    store.mkdir(parents=True, exist_ok=True)


def _check_space(store: Path, recipe: Recipe, frames: int) -> None:
    """Refuse to begin where the disk has no room for all frames."""
    needed, free = frames * bytes_per_frame(recipe), shutil.disk_usage(store).free
    if needed > free:
        raise UserError(
            f"prepare.out={store}: {_gigabytes(needed)} are needed for {frames} frames, "
            f"{_gigabytes(free)} are free; free some or choose another folder"
        )


def bytes_per_frame(recipe: Recipe) -> int:
    """Bytes of one frame in all arrays of a store."""
    total = 0
    for shape, dtype in shapes(recipe.size_hw, recipe.normals != "none").values():
        size = int(dtype[-1])
        for side in shape:
            size *= side
        total += size
    return total


def _report(
    store: Path, root: Path, source: SourceOptions, counts: Mapping[str, int], done: int, recipe: Recipe
) -> None:
    total = sum(counts.values())
    print(
        f"prepared: {store}, {len(counts)} videos of {total} frames at {recipe.size_hw[0]} x "
        f"{recipe.size_hw[1]}, {_gigabytes(total * bytes_per_frame(recipe))}; "
        f"{done} now, {len(counts) - done} before"
    )
    is_known = store == beside(source.root, recipe.size_hw) or remember(root, store)
    size = f"data.size=[{recipe.size_hw[0]},{recipe.size_hw[1]}]"
    store_option = "" if is_known else f" and data.store={store}"
    print(f"train.py reads it with {size}{store_option}", flush=True)


def _gigabytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e8 else f"{count / 1e6:.1f} MB"

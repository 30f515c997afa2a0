"""Choose the prepared frames that a training reads, or report why it reads the files instead."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from col3d.data.cache import Recipe, Stored, StoredVideo, folder_of, read_video, videos_in
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.datasets.videos import frames_of
from col3d.data.options import SourceOptions
from col3d.data.splits import check_end, selection_of_any_video
from col3d.errors import DataError
from col3d.io.atomic import write_whole
from col3d.registry.annotations import plain

KNOWN = ".col3d_stores.json"
"""File in the root of a data set with the stores of its frames that are not beside it."""


def recipe_of(source: SourceOptions, frames: FrameSet, size_hw: tuple[int, int]) -> Recipe:
    """The recipe that prepared frames must match."""
    camera, decoding = frames.camera.resized(size_hw), frames.decoding()
    return Recipe(
        source.name,
        size_hw,
        source.normals,
        frames.max_depth,
        camera,
        plain(source.own) if decoding is None else decoding,
        frames.dense_truth,
    )


def beside(root: str | Path, size_hw: tuple[int, int]) -> Path:
    """Default folder of the prepared frames of a size, beside the data set."""
    root = Path(root).absolute()
    return root.with_name(f"{root.name}_{size_hw[0]}x{size_hw[1]}")


def remember(root: Path, store: Path) -> bool:
    """Record in the root where its frames were prepared; returns False if it cannot be written."""
    try:
        known = [str(path) for path in remembered(root)]
        if str(store) not in known:
            write_whole(root / KNOWN, json.dumps([*known, str(store)], indent=1) + "\n")
    except OSError:
        return False
    return True


def remembered(root: Path) -> list[Path]:
    """The stores that are recorded in a root."""
    try:
        return [Path(str(path)) for path in json.loads((root / KNOWN).read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError):
        return []


def stored_frames(
    source: SourceOptions,
    frames: FrameSet,
    entries: Sequence[str],
    size_hw: tuple[int, int],
    say: Callable[[str], None],
) -> Stored | None:
    """The prepared frames of these entries, or None where the files are to be read.

    Args:
        source: options of the data set; its `store` says where to look.
        frames: the data set, to look for files.
        entries: entries of the split.
        size_hw: requested height and width.
        say: called with a line on which store is read, or why one is not.

    Raises:
        DataError: a store that is named does not fit, or an array in it is not whole.
    """
    if source.store == "none":
        return None
    recipe, root = recipe_of(source, frames, size_hw), Path(source.root)
    if source.store != "auto":
        store = Path(source.store)
        if not store.is_dir():
            raise DataError(f"data.store={store}: no such folder; run col3d prepare, or take data.store=auto")
        result = _fitting(store, frames, entries, recipe, source.own.get("release", "auto"))
        if isinstance(result, str):
            raise DataError(f"data.store={store}: {result}; run col3d prepare again, or take data.store=auto")
        say(f"reads frames prepared in {store}")
        return result
    for store in dict.fromkeys([beside(root, size_hw), *remembered(root)]):
        if store.is_dir():
            result = _fitting(store, frames, entries, recipe, source.own.get("release", "auto"))
            if isinstance(result, Stored):
                say(f"reads frames prepared in {store}")
                return result
            say(f"note: reads the files, for {store} does not serve: {result}")
    return None


def _fitting(
    store: Path, frames: FrameSet, entries: Sequence[str], recipe: Recipe, release: str
) -> Stored | str:
    """The prepared frames of these entries, or the reason why the store cannot give them."""
    frames.frames = []
    present = list(frames.folders) if frames.root.is_dir() else videos_in(store)
    chosen: list[tuple[StoredVideo, Sequence[int]]] = []
    for entry in entries:
        selection = selection_of_any_video(entry, present)
        video = read_video(folder_of(store, selection.video))
        if video is None or video.video != selection.video:
            return f"{selection.video} is not prepared there"
        if differs := video.differs(recipe):
            return f"{selection.video} was prepared otherwise ({differs})"
        if release not in ("auto", video.release) and video.release:
            return f"{selection.video} was prepared as release {video.release}, not {release}"
        numbers = [number for number in video.frames if number in selection]
        if not frames.root.is_dir():
            check_end(selection, max(*video.frames, (frames_of(video.video) or 0) - 1))
        else:
            current = frames.find(entry)
            if stale := video.stale(frames.root, current):
                return stale
            frames.frames += current
            numbers = [frame.number for frame in current]
        if not numbers:
            return f"{entry} has no frame there"
        chosen.append((video, numbers))
    return Stored(chosen)

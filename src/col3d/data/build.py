"""Build data sets from checked options: frames of a split, at full resolution or at the network's size."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from col3d.data.cache import videos_in
from col3d.data.cache.choice import stored_frames
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.data.datasets.dataset_index import DatasetIndex
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.datasets.videos import video_table
from col3d.data.options import DataOptions, SourceOptions, built
from col3d.data.rendered import is_rendered, phantom_settings, render_missing
from col3d.data.sized import Joined, Resized, SizedFrames
from col3d.data.splits import (
    SPLITS,
    check_counts,
    check_end,
    expand,
    parse_selection,
    selection_of_any_video,
)
from col3d.data.transforms import Augment
from col3d.errors import DataError
from col3d.phantom.options import PhantomOptions
from col3d.registry import DATASETS

CUSTOM = "custom"
"""Name of a user's own split, whose numbers of frames are not checked."""


def resolve_source_paths(data: DataOptions, phantom: PhantomOptions) -> DataOptions:
    """The options with absolute paths, and with wildcards replaced by names of videos.

    Raises:
        DataError: a wildcard matches nothing.
    """
    also = {name: _settled(source, phantom) for name, source in data.also.items()}
    test = data.test and _settled(data.test, phantom)
    return _settled(data, phantom).model_copy(update={"also": also, "test": test})


Source = TypeVar("Source", bound=SourceOptions)


def _settled(source: Source, phantom: PhantomOptions) -> Source:
    parts = {part: getattr(source.split, part) for part in SPLITS}
    if any(set("*?") & set(entry) for part in parts.values() for entry in part):
        present = _videos_at_hand(source, phantom)
        parts = {part: expand(entries, present) for part, entries in parts.items()}
    root = str(Path(source.root).absolute())
    store = source.store if source.store in ("auto", "none") else str(Path(source.store).absolute())
    return source.model_copy(
        update={"root": root, "store": store, "split": source.split.model_copy(update=parts)}
    )


def frame_set(source: SourceOptions, phantom: PhantomOptions, entries: Sequence[str]) -> FrameSet:
    """The frames of these entries at full resolution.

    Raises:
        DataError: a file or folder is missing or not what it should be.
    """
    frames = built(source, entries, rendered=phantom)
    assert isinstance(frames, FrameSet)
    return frames


def dataset_index(source: SourceOptions, phantom: PhantomOptions) -> DatasetIndex:
    """Index of the videos and files of a data set.

    Raises:
        DataError: an option does not fit the data set.
    """
    return frame_set(source, phantom, [])


def entries_of(source: SourceOptions, phantom: PhantomOptions, part: str) -> list[str]:
    """Entries of a part of the split whose videos exist; missing videos of a phantom are rendered.

    Raises:
        DataError: a video is missing.
    """
    named = getattr(source.split, part)
    if is_rendered(source):
        chosen = [parse_selection(entry) for entry in named]
        for selection in chosen:
            check_end(selection, phantom.frames_per_video - 1)
        videos = sorted({selection.video for selection in chosen})
        render_missing(Path(source.root), phantom_settings(source, phantom, videos))
        return _at_hand(source, phantom, part, named, videos)
    return _at_hand(source, phantom, part, named, _videos_at_hand(source, phantom))


def full_frames(source: SourceOptions, phantom: PhantomOptions, part: str) -> FrameSet:
    """The frames of a part of the split at full resolution.

    Raises:
        DataError: a video is missing, or a file is not what it should be.
    """
    return _read_from_files(source, phantom, part, entries_of(source, phantom, part))


def _read_from_files(
    source: SourceOptions, phantom: PhantomOptions, part: str, entries: Sequence[str]
) -> FrameSet:
    frames = frame_set(source, phantom, entries)
    _check_counts(source, part, entries, [frame.video for frame in frames.frames], frames.releases)
    return frames


def sized_frames(
    source: SourceOptions,
    phantom: PhantomOptions,
    part: str,
    size: Sequence[int],
    say: Callable[[str], None] = print,
) -> SizedFrames:
    """The frames of a part of the split at a size: prepared ones where they fit, else from the files.

    `say` is called with a line on which of the two it is.

    Raises:
        DataError: a video is missing, or a file or a named store is not what it should be.
    """
    size_hw = (size[0], size[1])
    entries = entries_of(source, phantom, part)
    frames = frame_set(source, phantom, [])
    if names := other_folder_names(frames):
        say(names)
    stored = stored_frames(source, frames, entries, size_hw, say)
    if stored is None:
        frames = _read_from_files(source, phantom, part, entries)
    for note in frames.notes.values():
        say(f"note: {note}")
    if stored is None:
        return Resized(frames, size_hw)
    releases = {video.video: video.release for video in stored.stored}
    _check_counts(source, part, entries, stored.videos, releases)
    return stored


def other_folder_names(frames: FrameSet) -> str:
    """A line on videos that lie in folders of other names than here; empty where none does."""
    renamed = frames.renamed() if frames.root.is_dir() else {}
    if not renamed:
        return ""
    listed = ", ".join(f"{folder} is {video}" for video, folder in renamed.items())
    return f"note: {len(renamed)} of {len(frames.folders)} videos lie under other names: {listed}"


def data_module(
    options: DataOptions,
    phantom: PhantomOptions,
    seed: int,
    splits: Iterable[str] = SPLITS,
) -> FrameDataModule:
    """Loaders of frames at the network's size."""
    printed: list[str] = []

    def say(line: str) -> None:
        """Print a line once, not again for the next part."""
        if line not in printed:
            printed.append(line)
            print(line, flush=True)

    sets: dict[str, Frames] = {}
    weights: list[tuple[int, float]] = []
    sparse = False
    for part in splits:
        source = options.tested if part == "test" else options
        if part == "train":
            sources = [options, *options.also.values()]
            parts = [sized_frames(source, phantom, part, options.size, say) for source in sources]
            _check_weights(sources, parts)
            weights = [(len(frames), source.weight) for frames, source in zip(parts, sources, strict=True)]
            sets[part] = Joined(parts) if options.also else parts[0]
            sparse = not all(frames.dense_truth for frames in parts)
        else:
            sets[part] = sized_frames(source, phantom, part, options.size, say)
    return FrameDataModule(
        sets,
        batch_size=options.batch_size,
        workers=options.workers,
        augment=Augment(**options.augment.model_dump(), sparse=sparse),
        seed=seed,
        weights=weights,
    )


def _check_weights(sources: Sequence[SourceOptions], parts: Sequence[SizedFrames]) -> None:
    for source, frames in zip(sources, parts, strict=True):
        if round(len(frames) * source.weight) == 0:
            raise DataError(
                f"data.weight: {source.weight} of the {len(frames)} frames of {source.name} in {source.root} "
                "shows none of them; take a larger weight, or leave the data set out"
            )


def _videos_at_hand(source: SourceOptions, phantom: PhantomOptions) -> list[str]:
    """Names of the videos of the data set, or of the named store where there is no data set."""
    if is_rendered(source):
        return list(dict.fromkeys([*video_table(), *dataset_index(source, phantom).folders]))
    root, store = Path(source.root), Path(source.store)
    if not root.is_dir() and source.store not in ("auto", "none") and store.is_dir():
        return videos_in(store)
    return list(dataset_index(source, phantom).folders)


def _at_hand(
    source: SourceOptions, phantom: PhantomOptions, part: str, named: Sequence[str], present: Sequence[str]
) -> list[str]:
    """Entries of the split; those of missing videos are left out where that is allowed."""
    if Path(source.root).is_dir():
        index = dataset_index(source, phantom)
        for entry in named:
            if reason := index.unreachable(selection_of_any_video(entry, present).video):
                raise DataError(reason)
    videos = {entry: parse_selection(entry, present).video for entry in named}
    missing = list(dict.fromkeys(video for video in videos.values() if video not in present))
    if missing and not source.allow_missing:
        raise DataError(
            f"data.root={source.root}: videos {', '.join(missing)} of split {source.split.name} are missing; "
            "copy them there, name others in data.split, or set data.allow_missing=true to leave them out"
        )
    chosen = [entry for entry, video in videos.items() if video in present]
    if not chosen:
        raise DataError(f"data.root={source.root}: no video of data.split.{part} is there")
    if missing:
        print(f"note: left out, because data.allow_missing=true: {', '.join(missing)}", flush=True)
    return chosen


def _check_counts(
    source: SourceOptions, part: str, entries: Sequence[str], videos: Iterable[str], releases: dict[str, str]
) -> None:
    """Compare the splits that come with the program with the table of videos."""
    if not DATASETS[source.name].facts["table"] or source.allow_missing or source.split.name == CUSTOM:
        return
    counts = Counter(videos)
    for release in set(releases.values()):
        check_counts(entries, {v: n for v, n in counts.items() if releases[v] == release}, release)

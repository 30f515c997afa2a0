"""Fingerprint of the files of data sets: their sizes and modification times, or checksums of a store."""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from col3d.data.build import dataset_index
from col3d.data.cache import folder_of, read_video, videos_in
from col3d.data.datasets.dataset_index import DatasetIndex
from col3d.data.datasets.frame_files import Frame
from col3d.data.options import DataOptions, SourceOptions
from col3d.data.splits import SPLITS, selection_of_any_video
from col3d.errors import DataError
from col3d.phantom.options import PhantomOptions

State = dict[str, str]
"""Group of files, such as "depth of cecum_t1_a (c3vd, val)" -> number of files, bytes and a checksum."""


def data_state(data: DataOptions, phantom: PhantomOptions) -> State:
    """State of every frame that a training reads, in all parts of its split."""
    parts = {part: data.tested if part == "test" else data for part in SPLITS}
    state: State = {}
    for part, source in parts.items():
        state |= part_state(source, phantom, part)
    for source in data.also.values():
        state |= part_state(source, phantom, "train")
    return state


def part_state(source: SourceOptions, phantom: PhantomOptions, part: str) -> State:
    """State of the frames of one part of a split; missing files are left out."""
    entries = getattr(source.split, part)
    if not Path(source.root).is_dir():
        return _of_store(source, entries)
    index = dataset_index(source, phantom)
    kinds = _files(index, entries)
    state = {
        f"{kind} of {video} ({source.name}, {part})": _summed(index.root, paths)
        for (video, kind), paths in kinds.items()
    }
    layout = source.own.get("layout")
    if layout is not None and (camera := index.root / layout.camera_file).is_file():
        state[f"camera ({source.name})"] = _summed(index.root, [camera])
    return state


def _files(index: DatasetIndex, entries: Iterable[str]) -> dict[tuple[str, str], list[Path]]:
    paths: dict[tuple[str, str], list[Path]] = defaultdict(list)
    for frame in _existing_frames(index, entries):
        for kind, path in frame.files.items():
            paths[frame.video, kind].append(path)
    return paths


def _existing_frames(index: DatasetIndex, entries: Iterable[str]) -> Iterator[Frame]:
    for entry in entries:
        try:
            yield from index.find(entry)
        except DataError:  # may be missing; where it may not, reading it raises this error
            continue


def _summed(root: Path, paths: Iterable[Path]) -> str:
    """Number of files, bytes, and a checksum of names, sizes and modification times."""
    total, count, size = hashlib.blake2b(digest_size=8), 0, 0
    for path in paths:
        try:
            status = path.stat()
        except OSError:  # deleted since it was listed
            continue
        total.update(
            f"{path.relative_to(root).as_posix()}\0{status.st_size}\0{status.st_mtime_ns}\n".encode()
        )
        count, size = count + 1, size + status.st_size
    return f"{count} files, {size} bytes, {total.hexdigest()}"


def _of_store(source: SourceOptions, entries: Iterable[str]) -> State:
    """State by the checksums that a store keeps of its arrays, where the files themselves are absent."""
    store, state = Path(source.store), {}
    present = videos_in(store) if store.is_dir() else []
    for name in dict.fromkeys(selection_of_any_video(entry, present).video for entry in entries):
        video = read_video(folder_of(store, name))
        for kind, shard in ({} if video is None else video.shards).items():
            state[f"{kind} of {name} (store)"] = f"{shard.bytes} bytes, crc32 {shard.crc32:08x}"
    return state

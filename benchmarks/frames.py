"""What is measured on: full-size frames on disk, and a store of them that is longer than they are."""

import shutil
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path

from col3d.data.cache import Recipe, StoredVideo, read_video, write_video
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.sized import Resized
from col3d.errors import DataError
from col3d.phantom import PhantomSettings, phantom_camera, render_phantom

PHANTOM_VIDEOS = ("cecum_t1_a", "trans_t1_a")
READERS = {"c3vd": C3VD, "c3vdv2": C3VDv2}


def frames_of(
    data: str, root: Path | None, cache: Path, full_size_hw: tuple[int, int], count: int
) -> list[FrameSet]:
    """Videos that have so many frames together, one set each.

    Args:
        data: phantom, or real frames of which data set.
        root: of the real ones.
        cache: where the phantom is rendered, if it is not there yet.
        full_size_hw: of the phantom's frames.
        count: of frames; where real ones are fewer, all.

    Raises:
        DataError: a file is not what it should be, or there are no normals.
    """
    if data == "phantom":
        return _phantom(cache, full_size_hw, count)
    if root is None:
        raise DataError(f"ROOT: a value is needed; give the folder of the videos of {data}")
    return _real(READERS[data], root, count)


def _phantom(cache: Path, size_hw: tuple[int, int], count: int) -> list[FrameSet]:
    each = -(-count // len(PHANTOM_VIDEOS))
    settings = PhantomSettings(size_hw, each, videos=PHANTOM_VIDEOS)
    root = cache / f"phantom_{size_hw[0]}x{size_hw[1]}_{each}"
    render_phantom(root, settings)
    return [C3VD(root, [video], "current", camera=phantom_camera(settings)) for video in PHANTOM_VIDEOS]


def _real(reader: type[C3VD], root: Path, count: int) -> list[FrameSet]:
    found: list[FrameSet] = []
    for video, folder in reader.video_folders(root).items():
        numbers = sorted(reader.kinds["normals"].find(folder))[: count - sum(map(len, found))]
        if numbers:
            found.append(reader(root, [f"{video}:{numbers[0]}-{numbers[-1]}"]))
    if not found:
        raise DataError(f"{root}: no video in it has normals, which are timed too")
    return found


def repeated(parts: Sequence[FrameSet], count: int) -> FrameSet:
    """One set of exactly so many frames, from the first again where there are fewer."""
    joined = copy(parts[0])
    joined.releases = {video: release for part in parts for video, release in part.releases.items()}
    joined.frames = list(islice(cycle([frame for part in parts for frame in part.frames]), count))
    return joined


def prepared(
    parts: Sequence[FrameSet], store: Path, size_hw: tuple[int, int], count: int
) -> list[StoredVideo]:
    """The frames in a store, their videos copied until it has at least so many, each in pages of its own."""
    videos: list[StoredVideo] = []
    for frames in parts:
        resized = Resized(frames, size_hw)
        (camera,) = resized.cameras
        recipe = Recipe("speed", size_hw, frames.normals, frames.max_depth, camera)
        write_video(store, resized, recipe, lambda: None)
        video = read_video(store / frames.frames[0].video)
        assert video is not None
        videos.append(video)
    originals = cycle(list(videos))
    while sum(len(video.frames) for video in videos) < count:
        original = next(originals)
        name = f"{original.video}_{len(videos)}"
        shutil.copytree(original.folder, store / name)
        videos.append(replace(original, folder=store / name, video=name))
    return videos

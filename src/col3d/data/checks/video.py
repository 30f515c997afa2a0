"""Checks of one video: it is cut into chunks of frames, which are checked and compared."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch

from col3d.data.checks.findings import Finding, FrameReport
from col3d.data.checks.frame import check_frame, read_depth
from col3d.data.checks.listing import list_frames
from col3d.data.checks.poses import read_poses
from col3d.data.checks.reproject import Pose, reproject
from col3d.data.datasets.frame_files import Frame
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.errors import DataError
from col3d.geometry import Camera

CHUNK = 16
"""Frames that one process checks at a time: few enough that one long video keeps all cores busy."""
FAST_PAIRS = 4
"""Pairs of neighbouring frames that are decoded of a video in a fast check."""


@dataclass(frozen=True)
class Chunk:
    """Neighbouring frames of one video.

    Attributes:
        frames: frames to check.
        following: the frame after them, whose depth is compared with that of the last one.
        in_full: numbers of the frames to decode.
        poses: poses by number, of the frames that have one and of the frame before the first.
    """

    frames: tuple[Frame, ...]
    following: Frame | None
    in_full: frozenset[int]
    poses: Mapping[int, Pose]


@dataclass(frozen=True)
class Plan:
    """The frames of one video to check, and findings on its folder.

    Attributes:
        lines: number of lines of pose.txt; None where there is none.
        poses: camera-to-world matrices of the frames that have one.
    """

    video: str
    folder: Path
    frames: tuple[Frame, ...]
    chunks: tuple[Chunk, ...]
    lines: int | None
    poses: Mapping[int, Pose]
    findings: tuple[Finding, ...]

    @cached_property
    def numbers(self) -> dict[int, Frame]:
        """Frames by their number."""
        return {frame.number: frame for frame in self.frames}

    def path(self, number: int, kind: str) -> Path:
        """A file of one of its frames, or the folder where it has none."""
        return self.numbers[number].files.get(kind, self.folder)


def plan_video(frames: FrameSet, video: str, folder: Path, fast: bool = False) -> Plan:
    """List a video's frames, read its poses, and cut it into chunks.

    Args:
        frames: frames of the data set.
        video: name of the video.
        folder: folder of the video.
        fast: whether to decode only a few frames.
    """
    try:
        listed, findings = list_frames(frames, video, folder)
    except OSError as error:
        listed, findings = [], [Finding("file", f"{folder}: cannot be read ({error.strerror})", video)]
    except DataError as error:
        listed, findings = [], [Finding("pair", str(error), video)]
    poses, lines, place = dict[int, Pose](), None, folder / "pose.txt"
    if place.is_file():
        poses, lines, broken = read_poses(place, video)
        findings += broken
    chunks = tuple(_chunks(listed, poses, fast))
    return Plan(video, folder, tuple(listed), chunks, lines, poses, tuple(findings))


def _chunks(listed: Sequence[Frame], poses: Mapping[int, Pose], fast: bool) -> list[Chunk]:
    in_full = frozenset(listed[place].number for place in _decoded(len(listed), fast))
    chunks = []
    for start in range(0, len(listed), CHUNK):
        chunk, following = tuple(listed[start : start + CHUNK]), listed[start + CHUNK : start + CHUNK + 1]
        numbers = {frame.number for frame in (*chunk, *following)}
        chunk_poses = {number: pose for number, pose in poses.items() if numbers & {number, number + 1}}
        chunks.append(Chunk(chunk, following[0] if following else None, in_full & numbers, chunk_poses))
    return chunks


def _decoded(count: int, fast: bool) -> set[int]:
    """Positions of the frames to decode: all, or a few pairs of neighbours over the whole video."""
    if not fast or count <= 2 * FAST_PAIRS:
        return set(range(count))
    firsts = [round(n * (count - 2) / (FAST_PAIRS - 1)) for n in range(FAST_PAIRS)]
    return {place for first in firsts for place in (first, first + 1)}


def check_chunk(frames: FrameSet, chunk: Chunk, frame_done: Callable[[], None]) -> list[FrameReport]:
    """Check each frame, and compare the depth of each with that of the next.

    Args:
        frames: frames of the data set.
        chunk: frames to check.
        frame_done: called after each frame.
    """
    torch.set_num_threads(1)
    reports: list[FrameReport] = []
    before: Depth | None = None
    for frame in chunk.frames:
        both = (chunk.poses.get(frame.number), chunk.poses.get(frame.number - 1))
        moved = None if both[0] is None or both[1] is None else (both[0], both[1])
        report, depth = check_frame(frames, frame, frame.number in chunk.in_full, moved)
        if before is not None and depth is not None:
            _compare(frames.camera, chunk.poses, reports[-1], (before, depth), frame.number)
        reports.append(report)
        before = depth
        frame_done()
    following = chunk.following
    if (
        following is not None
        and before is not None
        and {following.number} <= chunk.in_full & chunk.poses.keys()
    ):
        depth = read_depth(frames, following)
        if depth is not None:
            _compare(frames.camera, chunk.poses, reports[-1], (before, depth), following.number)
    return reports


def _compare(
    camera: Camera, poses: Mapping[int, Pose], report: FrameReport, depths: tuple[Depth, Depth], to: int
) -> None:
    """Compare the depth of a frame with that of the next, where both have a pose."""
    if report.number in poses and to in poses:
        both = (poses[report.number], poses[to])
        report.reprojection = reproject(*depths, both, camera, to)

"""Which frames a video has, and which of their files are missing."""

import re
from collections.abc import Mapping
from pathlib import Path

from col3d.data.frames import Frame, FrameSet, Kind
from col3d.data.verify.findings import Finding

EXTRA = ("occlusion",)
"""Kinds of files that are checked where they are there."""


def list_frames(frames: FrameSet, video: str, folder: Path) -> tuple[list[Frame], list[Finding]]:
    """The frames of a video with the files at hand, and what is missing or there twice.

    Args:
        frames: of the data set, for its kinds of files.
        video: its name.
        folder: it lies in.
    """
    kinds = [kind for kind in (*frames.needed(), *EXTRA) if kind in frames.kinds]
    findings: list[Finding] = []
    found = {kind: _files(frames.kinds[kind], folder, video, findings) for kind in kinds}
    numbers = sorted(set().union(*(found[kind] for kind in frames.needed())))
    for kind in frames.needed():
        missing = [number for number in numbers if number not in found[kind]]
        findings += _missing(frames.kinds[kind], kind, folder, video, missing, len(numbers))
    listed = [Frame(video, n, {kind: found[kind][n] for kind in kinds if n in found[kind]}) for n in numbers]
    return listed, findings


def _files(kind: Kind, folder: Path, video: str, findings: list[Finding]) -> Mapping[int, Path]:
    """As `Kind.find`, but what is there twice is noted and the rest goes on."""
    before, after = (re.escape(part) for part in Path(kind.name).name.split("{}"))
    place, found = folder / Path(kind.name).parent, dict[int, Path]()
    for path in sorted(place.iterdir()) if place.is_dir() else ():
        if match := re.fullmatch(rf"{before}(\d+){after}", path.name):
            number = int(match.group(1))
            first = found.setdefault(number, path)
            if first != path:
                text = f"{path}: the same frame as {first.name}; keep one of them"
                findings.append(Finding("pair", text, video, number))
    return found


def _missing(
    kind: Kind, name: str, folder: Path, video: str, missing: list[int], count: int
) -> list[Finding]:
    hint = "; data.normals=derived computes them from the depth" if name == "normals" else "; copy it again"
    if missing and len(missing) == count:
        text = f"{folder}: none of the {count} frames has its {kind.name.format('NNNN')}{hint}"
        return [Finding("pair", text, video)]
    return [
        Finding("pair", f"{folder}: frame {number} has no {kind.named(number)}{hint}", video, number)
        for number in missing
    ]

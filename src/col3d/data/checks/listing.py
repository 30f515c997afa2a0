"""List the frames of a video, and which of their files are missing."""

from pathlib import Path

from col3d.data.checks.findings import Finding
from col3d.data.datasets.frame_files import Frame, Kind
from col3d.data.datasets.frame_set import FrameSet

EXTRA = ("occlusion", "flow")
"""Kinds of files that are checked where they exist."""


def list_frames(frames: FrameSet, video: str, folder: Path) -> tuple[list[Frame], list[Finding]]:
    """List the frames of a video with the files that exist, and findings on missing and duplicate files.

    Args:
        frames: frames of the data set, for its kinds of files.
        video: name of the video.
        folder: folder of the video.
    """
    needed = frames.needed(video)
    kinds = [kind for kind in (*needed, *EXTRA) if kind in frames.kinds]
    findings: list[Finding] = []

    def note(number: int, fault: str) -> None:
        findings.append(Finding("pair", fault, video, number))

    files = frames.files(folder, kinds, twice=note)
    if how := frames.notes.get(folder):
        findings.append(Finding("pair", how, video, fault=False))
    numbers = sorted(set().union(*(files[kind] for kind in needed)))
    for kind in needed:
        missing = [number for number in numbers if number not in files[kind]]
        findings += _missing(frames.kinds[kind], kind, folder, video, missing, len(numbers))
    listed = [Frame(video, n, {kind: files[kind][n] for kind in kinds if n in files[kind]}) for n in numbers]
    return listed, findings


def _missing(
    kind: Kind, name: str, folder: Path, video: str, missing: list[int], count: int
) -> list[Finding]:
    hint = "; data.normals=derived computes them from the depth" if name == "normals" else "; copy it again"
    if missing and len(missing) == count:
        text = f"{folder}: none of the {count} frames has its {kind.named('NNNN')}{hint}"
        return [Finding("pair", text, video)]
    return [
        Finding("pair", f"{folder}: frame {number} has no {kind.named(number, folder)}{hint}", video, number)
        for number in missing
    ]

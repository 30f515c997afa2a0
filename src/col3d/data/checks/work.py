"""What one process checks at a time: a chunk of a video's frames, or what belongs to a video as a whole."""

from collections.abc import Callable
from dataclasses import dataclass

from col3d.data.checks.findings import Finding, FrameReport
from col3d.data.checks.lens import LensReport, check_lens
from col3d.data.checks.video import Chunk, Plan, check_chunk
from col3d.data.datasets.coverage_mesh import COVERAGE_MESH, read_coverage_mesh
from col3d.data.datasets.frame_set import FrameSet
from col3d.errors import DataError


@dataclass(frozen=True)
class WholeReport:
    """What came of a video as a whole.

    Attributes:
        lens: how well it fits depth and poses.
        findings: of its coverage mesh.
    """

    lens: LensReport
    findings: tuple[Finding, ...]


def check(
    frames: FrameSet, part: Chunk | Plan, frame_done: Callable[[], None]
) -> list[FrameReport] | WholeReport:
    """Check the frames of a chunk, or lens and coverage mesh of the video of a plan.

    Args:
        frames: of the data set.
        part: what to check.
        frame_done: called after each frame of a chunk.
    """
    if isinstance(part, Plan):
        return WholeReport(check_lens(frames, part), tuple(_coverage(part)))
    return check_chunk(frames, part, frame_done)


def _coverage(plan: Plan) -> list[Finding]:
    """What is wrong with the coverage mesh, where there is one."""
    path = plan.folder / COVERAGE_MESH
    if not path.is_file():
        return []
    try:
        mesh = read_coverage_mesh(path)
    except DataError as error:
        return [Finding("coverage", str(error), plan.video)]
    if mesh.observed is None:
        text = f"{path}: does not say which faces were observed"
        return [Finding("coverage", text, plan.video, fault=False)]
    return []

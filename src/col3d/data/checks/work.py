"""Units of work of a verification: a chunk of a video's frames, or a video as a whole."""

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
    """Results of the checks of a video as a whole.

    Attributes:
        lens: how well the lens fits depth and poses.
        findings: findings on its coverage mesh.
    """

    lens: LensReport
    findings: tuple[Finding, ...]


def check(
    frames: FrameSet, part: Chunk | Plan, frame_done: Callable[[], None]
) -> list[FrameReport] | WholeReport:
    """Check the frames of a chunk, or lens and coverage mesh of the video of a plan.

    Args:
        frames: frames of the data set.
        part: chunk or plan to check.
        frame_done: called after each frame of a chunk.
    """
    if isinstance(part, Plan):
        return WholeReport(check_lens(frames, part), tuple(_coverage(part)))
    return check_chunk(frames, part, frame_done)


def _coverage(plan: Plan) -> list[Finding]:
    """Findings on the coverage mesh, where there is one."""
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

"""What one process checks at a time: a chunk of a video's frames, or the lens of a whole video."""

from collections.abc import Callable

from col3d.data.frames import FrameSet
from col3d.data.verify.findings import FrameReport
from col3d.data.verify.lens import LensReport, check_lens
from col3d.data.verify.video import Chunk, Plan, check_chunk


def check(
    frames: FrameSet, part: Chunk | Plan, frame_done: Callable[[], None]
) -> list[FrameReport] | LensReport:
    """Check the frames of a chunk, or the lens by a few frames of a plan.

    Args:
        frames: of the data set.
        part: what to check.
        frame_done: called after each frame of a chunk.
    """
    return check_lens(frames, part) if isinstance(part, Plan) else check_chunk(frames, part, frame_done)

"""Choose by rule the frames that figures show."""

import numpy as np

from col3d.reports.figures.figure import MissingError
from col3d.reports.figures.maps import Frame
from col3d.reports.paper_tables import training_shares
from col3d.reports.runs import Run


def best_average_worst(run: Run) -> dict[Frame, str]:
    """The frames of lowest abs_rel, of that nearest to the mean over frames, and of the highest.

    Of equals, the first in the order of videos and frames; a frame may be several of them.

    Raises:
        MissingError: no frame has a value.
    """
    values = run.values("abs_rel")
    having = np.flatnonzero(np.isfinite(values))
    if len(having) == 0:
        raise MissingError(f"no frame of {run.name} has abs_rel")
    values = values[having]
    picks = {
        "best": values.argmin(),
        "average": np.abs(values - values.mean()).argmin(),
        "worst": values.argmax(),
    }
    chosen: dict[Frame, str] = {}
    for name, pick in picks.items():
        frame = _frame(run, int(having[pick]))
        chosen[frame] = f"{chosen[frame]}, {name}" if frame in chosen else name
    return chosen


def one_a_segment(run: Run) -> dict[Frame, str]:
    """The middle one of each segment's frames, in the order of videos and frames.

    Segments are in the order in which the paper prints them; a data set without segments is taken as one.
    """
    order = list(training_shares())
    segments = {str(name) for name in run.frames["segment"]}
    chosen = {}
    for segment in sorted(segments, key=lambda name: (order.index(name) if name in order else 99, name)):
        rows = np.flatnonzero(run.frames["segment"] == segment)
        chosen[_frame(run, int(rows[len(rows) // 2]))] = segment or "no segment"
    return chosen


def _frame(run: Run, row: int) -> Frame:
    return str(run.frames["video"][row]), int(run.frames["frame"][row])

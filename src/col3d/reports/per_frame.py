"""`per_frame.csv`: one row for each evaluated frame, the source of every table."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from col3d.whole import write_whole

DEPTH_METRICS = ("abs_rel", "sq_rel", "log10", "rmse", "rmse_log", "silog", "delta1", "delta2", "delta3")
NORMAL_METRICS = ("angle_mean", "angle_median", "within_11_25", "within_22_5", "within_30")
METRICS = (*DEPTH_METRICS, *NORMAL_METRICS)
STRICT = "delta_1_1"
"""The share of pixels within 10 %, beside the usual metrics; tables of before lack it."""
ROOTS = ("rmse", "rmse_log")
"""Metrics whose squares are averaged over pixels."""
AVERAGES = ("frame", "video", "pixel")
"""What weighs the same in a mean."""
IDENTITY = ("model", "seed", "data", "split", "video", "segment", "texture", "frame", "protocol")
PIXELS = "pixels"
"""How many pixels a frame counted; tables of before lack it."""
COLUMNS = (*IDENTITY, *METRICS, STRICT, PIXELS)
Row = Mapping[str, str | int | float]


def write_per_frame(path: Path, rows: Iterable[Row]) -> None:
    """Write the table in one step; metrics that a model does not have stay empty."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, restval="")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())


def read_per_frame(path: Path) -> list[dict[str, str]]:
    """The rows of a table as text; older tables lack the last two columns.

    Raises:
        ValueError: another column is missing.
    """
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [
            name
            for name in (*IDENTITY, *DEPTH_METRICS, *NORMAL_METRICS)
            if name not in (reader.fieldnames or ())
        ]
        if missing:
            raise ValueError(f"{path}: columns {', '.join(missing)} are missing")
        return list(reader)


def means(rows: Sequence[Row], average: str = "frame") -> dict[str, float]:
    """Mean of every metric that the rows have; a frame without valid pixels has none.

    Args:
        rows: of one run.
        average: what weighs the same: each "frame", each "video" whatever its length, or each "pixel" that
            counts (squares are averaged for rmse and rmse_log; the others are means of frames' values).

    Raises:
        ValueError: the average is unknown.
    """
    if average not in AVERAGES:
        raise ValueError(f"average: expected {', '.join(AVERAGES)}, got {average!r}")
    if average == "video":
        return _mean_of([means(of_it) for of_it in by_video(rows).values()])
    found = {}
    for name in (*METRICS, STRICT):
        having = [row for row in rows if row.get(name, "") != ""]
        weights = [float(row["pixels"]) if average == "pixel" else 1.0 for row in having]
        power = 2 if average == "pixel" and name in ROOTS else 1
        total = sum(w * float(row[name]) ** power for w, row in zip(weights, having, strict=True))
        if sum(weights) > 0:
            found[name] = (total / sum(weights)) ** (1 / power)
    return found


def _mean_of(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    having = {name: [v[name] for v in values if name in v] for name in (*METRICS, STRICT)}
    return {name: sum(of_it) / len(of_it) for name, of_it in having.items() if of_it}


def by_video(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Rows grouped by video, in their order."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(str(row["video"]), []).append(row)
    return groups

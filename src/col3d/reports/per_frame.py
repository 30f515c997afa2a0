"""`per_frame.csv`: one row for each evaluated frame, the source of every table."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

DEPTH_METRICS = ("abs_rel", "sq_rel", "log10", "rmse", "rmse_log", "silog", "delta1", "delta2", "delta3")
NORMAL_METRICS = ("angle_mean", "angle_median", "within_11_25", "within_22_5", "within_30")
METRICS = (*DEPTH_METRICS, *NORMAL_METRICS)
IDENTITY = ("model", "seed", "data", "split", "video", "segment", "texture", "frame", "protocol")
Row = Mapping[str, str | int | float]


def write_per_frame(path: Path, rows: Iterable[Row]) -> None:
    """Write the table in one step; metrics that a model does not have stay empty."""
    partial = path.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*IDENTITY, *METRICS], restval="")
        writer.writeheader()
        writer.writerows(rows)
    partial.replace(path)


def read_per_frame(path: Path) -> list[dict[str, str]]:
    """The rows of a table as text.

    Raises:
        ValueError: a column is missing.
    """
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [name for name in (*IDENTITY, *METRICS) if name not in (reader.fieldnames or ())]
        if missing:
            raise ValueError(f"{path}: columns {', '.join(missing)} are missing")
        return list(reader)


def means(rows: Sequence[Row]) -> dict[str, float]:
    """Mean over frames of every metric that the rows have; a frame without valid pixels has none."""
    found = {}
    for name in METRICS:
        values = [float(row[name]) for row in rows if row.get(name, "") != ""]
        if values:
            found[name] = sum(values) / len(values)
    return found


def by_video(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Rows grouped by video, in their order."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(str(row["video"]), []).append(row)
    return groups

"""`per_frame.csv`: one row for each evaluated frame, the source of every table."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from col3d.io.atomic import write_whole
from col3d.registry.earlier import NAMES
from col3d.registry.metric_specs import OURS, MetricSpec

AVERAGES = ("frame", "video", "pixel")
"""Units that weigh the same in a mean."""
IDENTITY = ("model", "seed", "data", "split", "video", "segment", "texture", "frame", "protocol")
PIXELS = "pixels"
"""Column with the number of pixels of a frame that count; older tables lack it."""
Row = Mapping[str, str | int | float]


def write_per_frame(path: Path, rows: Iterable[Row], metrics: Iterable[str] = tuple(OURS)) -> None:
    """Write the table in one step; metrics that a model does not have stay empty.

    Args:
        path: file to write.
        rows: for each frame its values by column.
        metrics: names of the columns of metrics.

    Raises:
        ValueError: a row has another column.
    """
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, (*IDENTITY, *metrics, PIXELS), restval="")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())


def read_per_frame(path: Path) -> list[dict[str, str]]:
    """Read the rows of a table as text; an older table has the metrics of its time.

    Raises:
        ValueError: a column that identifies the frame of a row is missing.
    """
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        missing = [name for name in IDENTITY if name not in (reader.fieldnames or ())]
        if missing:
            raise ValueError(f"{path}: columns {', '.join(missing)} are missing")
        return [{**row, "protocol": NAMES.get(row["protocol"], row["protocol"])} for row in reader]


def metrics_in(rows: Iterable[Row]) -> list[str]:
    """Names of the metrics that rows have: ours in their order, then others in that of the columns."""
    names = dict.fromkeys(name for row in rows for name in row if isinstance(name, str))
    others = [name for name in names if name not in OURS and name not in (*IDENTITY, PIXELS)]
    return [*(name for name in OURS if name in names), *others]


def means(
    rows: Sequence[Row], average: str = "frame", specs: Mapping[str, MetricSpec] = OURS
) -> dict[str, float]:
    """Mean of every metric that the rows have; a frame without valid pixels has none.

    Args:
        rows: rows of one run.
        average: unit that weighs the same: each "frame", each "video" whatever its length, or each "pixel"
            that counts, where the metric's spec says how: see `MetricSpec.over_pixels`.
        specs: specs of the metrics; one without a spec has no mean over pixels.

    Raises:
        ValueError: the average is unknown.
    """
    if average not in AVERAGES:
        raise ValueError(f"average: expected {', '.join(AVERAGES)}, got {average!r}")
    if average == "video":
        return _mean_of([means(video_rows, specs=specs) for video_rows in by_video(rows).values()])
    averages = {}
    for name in metrics_in(rows):
        over_pixels = specs[name].over_pixels if name in specs else None
        if average == "pixel" and over_pixels is None:
            continue
        having = [row for row in rows if row.get(name, "") not in ("", None)]
        weights = [float(row["pixels"]) if average == "pixel" else 1.0 for row in having]
        power = 2 if average == "pixel" and over_pixels == "root" else 1
        total = sum(w * float(row[name]) ** power for w, row in zip(weights, having, strict=True))
        if sum(weights) > 0:
            averages[name] = (total / sum(weights)) ** (1 / power)
    return averages


def _mean_of(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for video_means in values for name in video_means)
    having = {name: [v[name] for v in values if name in v] for name in names}
    return {name: sum(numbers) / len(numbers) for name, numbers in having.items()}


def by_video(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Rows grouped by video, in their order."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(str(row["video"]), []).append(row)
    return groups

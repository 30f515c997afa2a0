"""`summary.json` of a run, and the same as a table on screen."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from col3d.reports.per_frame import DEPTH_METRICS, NORMAL_METRICS, Row, by_video, means
from col3d.reports.screen import plain_console
from col3d.whole import write_whole

HEADINGS = {
    "abs_rel": "AbsRel",
    "sq_rel": "SqRel mm",
    "log10": "log10",
    "rmse": "RMSE mm",
    "rmse_log": "RMSElog",
    "silog": "SILog %",
    "delta1": "d1",
    "delta2": "d2",
    "delta3": "d3",
    "angle_mean": "mean deg",
    "angle_median": "median deg",
    "within_11_25": "< 11.25 deg",
    "within_22_5": "< 22.5 deg",
    "within_30": "< 30 deg",
}
DECIMALS = {"rmse": 2, "silog": 2, "angle_mean": 2, "angle_median": 2}
LOG_WIDTH = 120
"""Columns to take where the output is no terminal."""
ALL_FRAMES, BASELINE = "all frames", "mean training depth"


def summarise(rows: Sequence[Row], facts: Mapping[str, Any], average: str = "frame") -> dict[str, Any]:
    """Means over all frames and by video, beside facts about the run."""
    videos = {
        name: {"frames": len(of_it), **means(of_it, "pixel" if average == "pixel" else "frame")}
        for name, of_it in by_video(rows).items()
    }
    return {
        **facts,
        "average": average,
        "frames": len(rows),
        "frames_without_truth": sum(row.get("abs_rel", "") == "" for row in rows),
        "metrics": means(rows, average),
        "videos": videos,
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write in one step; what is not a finite number becomes null."""
    write_whole(path, json.dumps(_finite(content), indent=2, allow_nan=False) + "\n")


def _finite(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def print_summary(summary: Mapping[str, Any], console: Console | None = None) -> None:
    """All metrics by video and over all frames, with the mean training depth as the score to beat."""
    console = console or plain_console()
    if not console.is_terminal:
        console.width = max(console.width, LOG_WIDTH)
    title = "{model} on {data}, {split} split, seed {seed}, protocol {protocol}".format(**summary)
    console.print(_table(f"Depth: {title}", DEPTH_METRICS, summary))
    if NORMAL_METRICS[0] in summary["metrics"]:
        console.print(_table(f"Normals: {title}", NORMAL_METRICS, summary))
    if empty := summary.get("frames_without_truth"):
        console.print(f"{empty} of {summary['frames']} frames have no valid depth, and count in no mean")


def _table(title: str, metrics: Sequence[str], summary: Mapping[str, Any]) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("video", no_wrap=True)
    for heading in ("frames", *(HEADINGS[name] for name in metrics)):
        table.add_column(heading, justify="right")
    for name, *cells in rows_of(summary, metrics):
        if name == ALL_FRAMES:
            table.add_section()
        table.add_row(name, *cells, style={ALL_FRAMES: "bold", BASELINE: "dim"}.get(name))
    return table


def rows_of(summary: Mapping[str, Any], metrics: Sequence[str]) -> list[list[str]]:
    """Name, number of frames and metrics: of each video, of all frames, and of the score to beat."""
    rows = [
        [video, str(values["frames"]), *_cells(values, metrics)]
        for video, values in summary["videos"].items()
    ]
    count = str(summary["frames"])
    rows.append([ALL_FRAMES, count, *_cells(summary["metrics"], metrics)])
    if set(metrics) <= set(summary.get("baseline", ())):
        rows.append([BASELINE, count, *_cells(summary["baseline"], metrics)])
    return rows


def _cells(values: Mapping[str, Any], metrics: Sequence[str]) -> list[str]:
    return [_cell(values[name], DECIMALS.get(name, 3)) if name in values else "-" for name in metrics]


def _cell(value: float | int | None, decimals: int) -> str:
    return "nan" if value is None else f"{value:.{decimals}f}"

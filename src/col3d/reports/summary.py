"""Summary of a run: the content of `summary.json`, and a table of it on screen."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from col3d.registry.metric_specs import OURS, TASKS, MetricSpec, specs_from
from col3d.reports.per_frame import Row, by_video, means, metrics_in
from col3d.reports.screen import plain_console

LOG_WIDTH = 120
"""Width in columns where the output is no terminal."""
MOST = 12
"""Metrics that a protocol names and that are all printed."""
ALL_FRAMES, BASELINE = "all frames", "mean training depth"


def summarise(
    rows: Sequence[Row],
    facts: Mapping[str, Any],
    average: str = "frame",
    specs: Mapping[str, MetricSpec] = OURS,
) -> dict[str, Any]:
    """Means over all frames and by video, beside facts about the run and the specs of its metrics."""
    inside = "pixel" if average == "pixel" else "frame"
    depth = [name for name, spec in specs.items() if spec.task == "depth"]
    videos = {
        name: {"frames": len(video_rows), **means(video_rows, inside, specs)}
        for name, video_rows in by_video(rows).items()
    }
    return {
        **facts,
        "average": average,
        "frames": len(rows),
        "frames_without_truth": sum(all(row.get(name, "") == "" for name in depth) for row in rows),
        "metrics": means(rows, average, specs),
        "videos": videos,
        "metric_specs": {name: specs[name].plain() for name in metrics_in(rows) if name in specs},
    }


def specs_of(summary: Mapping[str, Any]) -> dict[str, MetricSpec]:
    """Specs of the metrics of a run: ours, then those that its summary records."""
    recorded = specs_from(summary.get("metric_specs") or {})
    return {**OURS, **{name: spec for name, spec in recorded.items() if name not in OURS}}


def on_screen(summary: Mapping[str, Any]) -> dict[str, list[MetricSpec]]:
    """The metrics that a run prints, by task; a task of which nothing was measured is left out."""
    named, specs = summary.get("metrics_named"), specs_of(summary)
    if named is not None:  # by the protocol, which measures nothing else
        specs = {name: specs[name] for name in named if name in specs}
    if named is None or len(specs) > MOST:
        specs = {name: spec for name, spec in specs.items() if spec.on_screen}
    tables = {task: [spec for spec in specs.values() if spec.task == task] for task in TASKS}
    return {
        task: [spec for spec in task_specs if spec.name in summary["metrics"] or spec.name in OURS]
        for task, task_specs in tables.items()
        if task == TASKS[0] or any(spec.name in summary["metrics"] for spec in task_specs)
    }


def scoring_lines(summary: Mapping[str, Any]) -> list[str]:
    """What a run was scored by, in two lines: mask and alignment, truth and average; none of earlier runs."""
    words = [f"{name}: {text}" for name, text in (summary.get("scoring") or {}).items()]
    return ["; ".join(words[start : start + 2]) for start in range(0, len(words), 2)]


def print_summary(summary: Mapping[str, Any], console: Console | None = None) -> None:
    """Print all metrics by video and over all frames, with the mean training depth as the score to beat."""
    console = console or plain_console()
    if not console.is_terminal:
        console.width = max(console.width, LOG_WIDTH)
    title = "{model} on {data}, {split} split, seed {seed}, protocol {protocol}".format(**summary)
    for task, metrics in on_screen(summary).items():
        console.print(_table(f"{task.capitalize()}: {title}", metrics, summary))
    for line in scoring_lines(summary):
        console.print(line, soft_wrap=True)
    if empty := summary.get("frames_without_truth"):
        console.print(f"{empty} of {summary['frames']} frames have no valid depth, and count in no mean")


def _table(title: str, metrics: Sequence[MetricSpec], summary: Mapping[str, Any]) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("video", no_wrap=True)
    for heading in ("frames", *(spec.screen_title for spec in metrics)):
        table.add_column(Text(heading), justify="right")
    for name, *cells in rows_of(summary, metrics):
        if name == ALL_FRAMES:
            table.add_section()
        table.add_row(name, *cells, style={ALL_FRAMES: "bold", BASELINE: "dim"}.get(name))
    return table


def rows_of(summary: Mapping[str, Any], metrics: Sequence[MetricSpec]) -> list[list[str]]:
    """Name, number of frames and metrics: of each video, of all frames, and of the score to beat."""
    rows = [
        [video, str(values["frames"]), *_cells(values, metrics)]
        for video, values in summary["videos"].items()
    ]
    count = str(summary["frames"])
    rows.append([ALL_FRAMES, count, *_cells(summary["metrics"], metrics)])
    if any(spec.name in summary.get("baseline", ()) for spec in metrics):
        rows.append([BASELINE, count, *_cells(summary["baseline"], metrics)])
    return rows


def _cells(values: Mapping[str, Any], metrics: Sequence[MetricSpec]) -> list[str]:
    return [
        _cell(values[spec.name], spec.screen_decimals) if spec.name in values else "-" for spec in metrics
    ]


def _cell(value: float | int | None, decimals: int) -> str:
    return "nan" if value is None else f"{value:.{decimals}f}"

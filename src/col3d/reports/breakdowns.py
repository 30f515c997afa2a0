"""Tables by segment of the colon, by video, and of the cost of each network."""

from collections.abc import Sequence

import numpy as np

from col3d.reports.compose import (
    PHANTOM,
    TITLES,
    complete_sample,
    having,
    specs_in,
    without_empty_columns,
)
from col3d.reports.experiments import Experiment, SeedGroup
from col3d.reports.notes import Notes
from col3d.reports.options import at
from col3d.reports.paper_tables import paper_table, training_shares
from col3d.reports.runs import Run
from col3d.reports.shares import training_frames
from col3d.reports.statistics import mean_and_std
from col3d.reports.tables import METRICS, Cell, Column, Line, Table, column_of

SPREAD = "Mean ± standard deviation (of the population, ddof=0) over the frames of all seeds."
COSTS = (
    Column("parameters", "Parameters", "Parameters", "down", 2, 1e-6, "M"),
    Column("gflop", "GFLOP", "GFLOP", "down", 2),
    Column("frames_per_second", "Frames/s", "Frames/s", "up", 1),
)


def segment_table(experiment: Experiment) -> Table | None:
    """Each segment by each method, with its share of the training frames; None where none is known."""
    notes, lines = Notes(), []
    papers = paper_table("per_segment")
    paper = papers if experiment.name == "benchmark" else {}
    columns = tuple(METRICS[name] for name in next(iter(papers.values())))  # those that the paper prints
    shares = _shares(experiment, bool(paper), notes)
    for segment in _present(experiment, "segment"):
        for row in experiment.rows:
            part, printed = _part(row, "segment", segment), paper.get(f"{segment}: {row.label}", {})
            cells = [_mean(part, column, notes, printed.get(column.key)) for column in columns]
            lines.append(Line((segment, shares.get(segment, "unknown"), row.label), tuple(cells)))
    if not lines:
        return None
    return Table(
        f"{experiment.name}_segments",
        f"{TITLES[experiment.name]} by segment",
        f"On {experiment.setting}. {SPREAD}",
        ("Segment", "Training frames", "Method"),
        columns,
        tuple(lines),
        (*_beside(experiment, bool(paper)), *notes.lines()),
        grouped=True,
    )


def video_table(experiment: Experiment) -> Table:
    """Each video by each method."""
    notes, lines = Notes(), []
    columns = having(experiment, [column_of(spec) for spec in specs_in(experiment).values() if spec.by_video])
    for video in _present(experiment, "video"):
        for row in experiment.rows:
            part = _part(row, "video", video)
            cells = [_mean(part, column, notes) for column in columns]
            frames = str(len(part.runs[0].frames["frame"]))
            lines.append(Line((video, frames, row.label), tuple(cells)))
    table = Table(
        f"{experiment.name}_videos",
        f"{TITLES[experiment.name]} by video",
        f"On {experiment.setting}. {SPREAD}",
        ("Video", "Frames", "Method"),
        tuple(columns),
        tuple(lines),
        (*_beside(experiment, False), *notes.lines()),
        grouped=True,
    )
    return without_empty_columns(table)


def cost_table(experiments: Sequence[Experiment]) -> Table:
    """Parameters, operations and speed of each network, as its runs measured them."""
    notes: list[str] = []
    lines, seen = [], set()
    for row in (row for experiment in experiments if experiment.name != "lambda" for row in experiment.rows):
        if row.runs[0].folder not in seen:
            seen.add(row.runs[0].folder)
            cells = tuple(_cost(row, column, notes) for column in COSTS)
            lines.append(Line((row.label, _size(row.runs[0])), cells))
    return Table(
        "cost",
        "Size and speed",
        "GFLOP and frames per second of one frame at a time, of the size given, on the machine of the run.",
        ("Method", "Size"),
        COSTS,
        tuple(lines),
        tuple(notes),
    )


def _cost(row: SeedGroup, column: Column, notes: list[str]) -> Cell:
    """Mean cost over the runs of a row; parameters and GFLOP must be equal in all of them."""
    costs = {run.name: _cost_of(run, column.key) for run in row.runs}
    values = [value for value in costs.values() if value is not None]
    if len(values) < len(costs):
        without = ", ".join(name for name, value in costs.items() if value is None)
        notes.append(f"{row.label}: left empty, for {column.key} is not in summary.json of {without}")
        return Cell()
    if column.key != "frames_per_second" and len(set(values)) > 1:
        notes.append(f"{row.label}: left empty, for its runs differ in {column.key}: {sorted(set(values))}")
        return Cell()
    std = float(np.std(values)) * column.scale if column.better == "up" and len(values) > 1 else None
    return Cell(float(np.mean(values)) * column.scale, std)


def _cost_of(run: Run, name: str) -> float | None:
    value = at(run.summary, f"cost.{name}")
    if value is None and name == "parameters":
        value = run.summary.get(name)
    return None if value is None else float(value)


def _size(run: Run) -> str:
    return " x ".join(map(str, at(run.summary, "cost.size") or at(run.options, "data.size") or ("unknown",)))


def _shares(experiment: Experiment, with_paper: bool, notes: Notes) -> dict[str, str]:
    """Segment -> percent of the training frames, and the paper's."""
    run = experiment.rows[0].runs[0]
    frames = training_frames(run.options)
    if frames is None:
        notes.more.append(
            "Shares of the training frames are not known: its list names videos of unknown length."
        )
        return {}
    total, trained = sum(frames.values()), at(run.summary, "frames_by_split.train")
    if trained not in (None, total):
        notes.more.append(f"Shares are by the lists of videos, {total} frames; {run.name} had {trained}.")
    printed = training_shares() if with_paper else {}
    return {
        segment: f"{100 * frames.get(segment, 0) / total:.0f} %"
        + (f" (paper {printed[segment]:.0f} %)" if segment in printed else "")
        for segment in _present(experiment, "segment")
    }


def _present(experiment: Experiment, name: str) -> list[str]:
    """Segments or videos of the scored frames, in the order in which the paper prints segments."""
    frames = experiment.rows[0].runs[0].frames
    order = list(training_shares())
    pairs = dict(zip(frames[name].tolist(), frames["segment"].tolist(), strict=True))
    known = [key for key in pairs if key]
    return sorted(known, key=lambda key: (order.index(pairs[key]) if pairs[key] in order else 99, key))


def _part(row: SeedGroup, name: str, value: str) -> SeedGroup:
    """A row's repetitions, reduced to the frames of one segment or video."""
    runs = []
    for run in row.runs:
        kept = run.frames[name] == value
        frames = {column: values[kept] for column, values in run.frames.items()}
        runs.append(Run(run.folder, run.options, run.summary, frames, run.name))
    return SeedGroup(f"{row.label}, {value}", tuple(runs))


def _mean(
    row: SeedGroup, column: Column, notes: Notes, paper: tuple[float, float | None] | None = None
) -> Cell:
    mean, std = paper or (None, None)
    sample = complete_sample(row, column, notes)
    if sample is None:
        return Cell(paper=mean, paper_std=std)
    value, spread = (number * column.scale for number in mean_and_std(sample))
    return Cell(value, spread, paper=mean, paper_std=std)


def _beside(experiment: Experiment, with_paper: bool) -> list[str]:
    notes = [PHANTOM] if experiment.setting.data == "phantom" else []
    paper_note = "The paper's numbers are on the test split of C3VD."
    return [*notes, paper_note] if with_paper else notes

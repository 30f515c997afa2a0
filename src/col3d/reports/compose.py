"""Makes the tables of a report from experiments: values, intervals, and the paper's numbers beside them."""

import numpy as np

from col3d.reports.experiments import Experiment, Repeats
from col3d.reports.notes import Notes
from col3d.reports.options import at
from col3d.reports.paper_tables import SPLIT_PARTS, Values, paper_table
from col3d.reports.statistics import (
    DRAWS,
    Interval,
    Sample,
    cluster_bootstrap,
    mean_and_std,
    paired_difference,
    sample_of,
)
from col3d.reports.tables import DEPTH, METRICS, NORMALS, Cell, Column, Line, Table, signed

PHANTOM = "A phantom is not C3VD: these numbers compare runs on the phantom and nothing else."
TITLES = {
    "benchmark": "Benchmark",
    "ablation": "Ablation",
    "lambda": "Weights of the loss",
}
BASELINES = {
    "benchmark": {"BTS": (*DEPTH, "delta_1_1")},
    "ablation": {"BTS": (*DEPTH, "delta_1_1"), "BTS-CBAM-MTL (L1)": NORMALS},
    "lambda": {"(0.5, 0.3, 0.2)": (*DEPTH, "delta_1_1", *NORMALS)},
}
"""What the rows of an experiment are held to, and by which metrics: BTS predicts no normals."""
STRICT = "delta_1_1"
COLUMNS = {"benchmark": (*DEPTH, STRICT)}
WITH_STD = ("benchmark",)
PARTS = {"val": "validation", "test": "test"}
NO_VALUES: Values = {}


def title_of(experiment: Experiment) -> str:
    """Heading of its table."""
    return TITLES.get(experiment.name, experiment.name.replace("other_", "Other runs "))


def main_table(experiment: Experiment) -> Table:
    """Means over frames with their intervals, and the paper's numbers."""
    name, notes = experiment.name, Notes()
    paper = paper_table(name) if name in SPLIT_PARTS else {}
    columns = [METRICS[key] for key in COLUMNS.get(name, (*DEPTH, STRICT, *NORMALS))]
    lines = []
    for row in experiment.rows:
        printed = paper.get(row.label, NO_VALUES)
        cells = [_measured(row, column, printed, notes, name in WITH_STD) for column in columns]
        lines.append(Line(_heads(experiment, row), tuple(cells)))
    spread = " ± standard deviation (of the population, ddof=0)" if name in WITH_STD else ""
    caption = (
        f"On {experiment.setting}. Mean{spread} over the frames of all seeds; in brackets the 95 % interval "
        f"of a bootstrap over videos and seeds, {DRAWS} draws."
    )
    table = Table(
        name,
        title_of(experiment),
        caption,
        _head_names(experiment),
        tuple(columns),
        tuple(lines),
        (
            *_comparison(experiment, bool(paper)),
            *(f"Left out: {line}" for line in experiment.left_out),
            *experiment.notes,
            *notes.lines(),
        ),
    )
    return without_empty_columns(table)


def difference_tables(experiment: Experiment) -> list[Table]:
    """Every row less a baseline on the same frames, where there is one and something to hold to it."""
    tables = [
        _differences(experiment, baseline, metrics)
        for baseline, metrics in BASELINES.get(experiment.name, {}).items()
    ]
    return [table for table in tables if table.rows and table.columns]


def _differences(experiment: Experiment, baseline: str, metrics: tuple[str, ...]) -> Table:
    base = next((row for row in experiment.rows if row.label == baseline), None)
    columns, notes, lines = [METRICS[key] for key in metrics], Notes(), []
    for row in experiment.rows if base else ():
        cells = tuple(_difference(row, base, column, notes) for column in columns) if base else ()
        if row is not base and any(cell.value is not None for cell in cells):
            lines.append(Line(_heads(experiment, row), cells))
    of_what = ", normals" if metrics == NORMALS else ""
    table = Table(
        f"{experiment.name}_differences{'_normals' if of_what else ''}",
        f"{title_of(experiment)}: differences from {baseline}{of_what}",
        f"On {experiment.setting}. Mean difference from {baseline} on the same frames with the same seeds, "
        "and its 95 % interval: where it holds 0, the videos and seeds at hand do not tell the two apart.",
        _head_names(experiment),
        tuple(signed(column) for column in columns),
        tuple(lines),
        (*_phantom(experiment), *notes.lines()),
    )
    return without_empty_columns(table)


def _measured(row: Repeats, column: Column, printed: Values, notes: Notes, with_std: bool) -> Cell:
    """Our mean, where every repetition has the metric, and the paper's."""
    mean, std = printed.get(column.key, (None, None))
    paper = {"paper": mean, "paper_std": std}
    sample = complete_sample(row, column, notes)
    if sample is None:
        return Cell(**paper)
    value, spread = (number * column.scale for number in mean_and_std(sample))
    interval = cluster_bootstrap(sample)
    notes.interval(row.label, interval)
    return Cell(value, spread if with_std else None, *_limits(interval, column), **paper)


def complete_sample(row: Repeats, column: Column, notes: Notes) -> Sample | None:
    """The values of a metric, None (and a note) where a repetition that should have it does not."""
    without = [run.name for run in row.runs if not np.isfinite(run.frames[column.key]).any()]
    if without:
        depth_alone = at(row.runs[0].options, "model.normals") == "none" and column.key in NORMALS
        if not depth_alone or len(without) < len(row.runs):
            lacks = notes.missing.setdefault(row.label, {}).setdefault(", ".join(without), [])
            lacks += [column.key] if column.key not in lacks else []
        return None
    sample = sample_of(row.runs, column.key)
    expected = sum(len(run.frames["frame"]) for run in row.runs)
    if len(sample.values) < expected:
        note = f"{row.label}: {expected - len(sample.values)} of {expected} frames have no {column.key}"
        notes.add(f"{note} and are not in its mean.")
    return sample


def _difference(row: Repeats, base: Repeats, column: Column, notes: Notes) -> Cell:
    ours, theirs = complete_sample(row, column, notes), complete_sample(base, column, notes)
    found = paired_difference(ours, theirs) if ours and theirs else None
    if found is None:
        return Cell()
    notes.interval(row.label, found.interval)
    if found.note:
        notes.add(f"{row.label}: {found.note}")
    return Cell(found.mean * column.scale, None, *_limits(found.interval, column))


def _limits(interval: Interval | None, column: Column) -> tuple[float | None, float | None]:
    return (None, None) if interval is None else (interval.low * column.scale, interval.high * column.scale)


def _comparison(experiment: Experiment, with_paper: bool) -> list[str]:
    """What the paper's numbers may be held to."""
    if not with_paper:
        return _phantom(experiment)
    setting = experiment.setting
    theirs, ours = PARTS[SPLIT_PARTS[experiment.name]], PARTS.get(setting.part, setting.part)
    what = f"The paper's numbers are on the {theirs} split of C3VD"
    if setting.data == "c3vd":
        what += f"; ours on the {ours} part of split {setting.split}, scored by protocol {setting.protocol}."
    else:
        what += f"; ours on the {ours} part of the {setting.data}."
    averaged = (
        "" if setting.average == "frame" else "Means are over frames here, whatever the protocol's are."
    )
    return [*_phantom(experiment), what, *([averaged] if averaged else [])]


def _phantom(experiment: Experiment) -> list[str]:
    return [PHANTOM] if experiment.setting.data == "phantom" else []


def _head_names(experiment: Experiment) -> tuple[str, ...]:
    if experiment.name not in TITLES:
        return ("Run", "Model", "Seeds")
    return ("Depth, normals, consistency" if experiment.name == "lambda" else "Method", "Seeds")


def _heads(experiment: Experiment, row: Repeats) -> tuple[str, ...]:
    seeds = ", ".join(str(run.summary["seed"]) for run in row.runs)
    if experiment.name not in TITLES:
        return (row.label, str(at(row.runs[0].options, "model.name")), seeds)
    return (row.label, seeds)


def without_empty_columns(table: Table) -> Table:
    """Drop columns in which no row has a number."""
    kept = [
        j
        for j in range(len(table.columns))
        if any(row.cells[j].value is not None or row.cells[j].paper is not None for row in table.rows)
    ]
    rows = tuple(Line(row.heads, tuple(row.cells[j] for j in kept)) for row in table.rows)
    columns = tuple(table.columns[j] for j in kept)
    return Table(
        table.name, table.title, table.caption, table.heads, columns, rows, table.notes, table.grouped
    )

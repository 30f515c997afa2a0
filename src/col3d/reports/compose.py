"""Build the tables of a report from experiments: values, intervals, and the paper's numbers beside them."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from col3d.registry.metric_specs import OURS, TASKS, MetricSpec
from col3d.reports.experiments import Experiment, SeedGroup, label_of
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
from col3d.reports.tables import Cell, Column, Line, Table, column_of, signed

PHANTOM = "A phantom is not C3VD: these numbers compare runs on the phantom and nothing else."
TITLES = {
    "benchmark": "Benchmark",
    "ablation": "Ablation",
    "lambda": "Weights of the loss",
}
BASELINES: dict[str, dict[str, tuple[str, ...]]] = {
    "benchmark": {"BTS": ("depth",)},
    "ablation": {"BTS": ("depth",), "BTS-CBAM-MTL (L1)": ("normals",)},
    "lambda": {"(0.5, 0.3, 0.2)": TASKS},
}
"""Baseline rows of each experiment, and the tasks whose metrics are compared: BTS predicts no normals."""
DEPTH_ALONE = ("benchmark",)
"""Experiments that show only the depth metrics of ours."""
WITH_STD = ("benchmark",)
PARTS = {"val": "validation", "test": "test"}
NO_VALUES: Values = {}
NO_TABLE: Mapping[str, Values] = MappingProxyType({})


def title_of(experiment: Experiment) -> str:
    """Heading of an experiment's table."""
    return TITLES.get(experiment.name, experiment.name.replace("other_", "Other runs "))


def main_table(experiment: Experiment) -> Table:
    """Means over frames with their intervals, and the paper's numbers."""
    name = experiment.name
    paper = paper_table(name) if name in SPLIT_PARTS else {}
    columns = [column_of(spec) for spec in specs_in(experiment).values() if not spec.further]
    if name in DEPTH_ALONE:
        columns = [column for column in columns if column.key not in OURS or column.task == "depth"]
    notes = (
        *_comparison(experiment, bool(paper)),
        *(f"Left out: {line}" for line in experiment.left_out),
        *experiment.notes,
    )
    return _means(experiment, name, title_of(experiment), columns, paper, notes)


def further_table(experiment: Experiment) -> Table | None:
    """Our metrics that the paper does not print; None where no run has any."""
    columns = [column_of(spec) for spec in specs_in(experiment).values() if spec.further]
    title = f"{title_of(experiment)}: further metrics"
    table = _means(experiment, f"{experiment.name}_further", title, columns, {}, _phantom(experiment))
    return table if table.columns else None


def specs_in(experiment: Experiment) -> dict[str, MetricSpec]:
    """Specs of the metrics of all runs of an experiment: by task, ours first."""
    specs = dict(OURS)
    for run in (run for row in experiment.rows for run in row.runs):
        specs |= {name: spec for name, spec in run.specs.items() if name not in specs or not specs[name].task}
    order = [*TASKS, ""]
    return dict(
        sorted(specs.items(), key=lambda item: order.index(item[1].task) if item[1].task in order else 2)
    )


def _means(
    experiment: Experiment,
    name: str,
    title: str,
    columns: Sequence[Column],
    paper: Mapping[str, Values],
    leading_notes: Iterable[str],
) -> Table:
    """Means over frames with their intervals."""
    notes, lines, with_std = Notes(), [], experiment.name in WITH_STD
    columns = having(experiment, columns, paper)
    for row in experiment.rows:
        printed = paper.get(row.label, NO_VALUES)
        cells = [_measured(row, column, printed, notes, with_std) for column in columns]
        lines.append(Line(_heads(experiment, row), tuple(cells)))
    spread = " ± standard deviation (of the population, ddof=0)" if with_std else ""
    caption = (
        f"On {experiment.setting}. Mean{spread} over the frames of all seeds; in brackets the 95 % interval "
        f"of a bootstrap over videos and seeds, {DRAWS} draws."
    )
    heads = _head_names(experiment)
    table = Table(name, title, caption, heads, tuple(columns), tuple(lines), (*leading_notes, *notes.lines()))
    return without_empty_columns(table)


def having(
    experiment: Experiment, columns: Sequence[Column], paper: Mapping[str, Values] = NO_TABLE
) -> list[Column]:
    """Columns for which any run, or the paper, has a value; the others are not noted as missing."""
    runs = [run for row in experiment.rows for run in row.runs]
    printed = {metric for values in paper.values() for metric in values}
    return [
        column
        for column in columns
        if column.key in printed or any(np.isfinite(run.values(column.key)).any() for run in runs)
    ]


def difference_tables(experiment: Experiment) -> list[Table]:
    """Differences of every row from a baseline on the same frames, where both exist."""
    tables = [
        _differences(experiment, baseline, tasks)
        for baseline, tasks in BASELINES.get(experiment.name, {}).items()
    ]
    return [table for table in tables if table.rows and table.columns]


def _differences(experiment: Experiment, baseline: str, tasks: tuple[str, ...]) -> Table:
    base = next((row for row in experiment.rows if row.label == baseline), None)
    specs = [s for s in specs_in(experiment).values() if s.task in tasks and not s.further]
    columns, notes, lines = having(experiment, [column_of(spec) for spec in specs]), Notes(), []
    for row in experiment.rows if base else ():
        cells = tuple(_difference(row, base, column, notes) for column in columns) if base else ()
        if row is not base and any(cell.value is not None for cell in cells):
            lines.append(Line(_heads(experiment, row), cells))
    suffix = ", normals" if tasks == ("normals",) else ""
    table = Table(
        f"{experiment.name}_differences{'_normals' if suffix else ''}",
        f"{title_of(experiment)}: differences from {baseline}{suffix}",
        f"On {experiment.setting}. Mean difference from {baseline} on the same frames with the same seeds, "
        "and its 95 % interval: where it holds 0, the videos and seeds at hand do not tell the two apart.",
        _head_names(experiment),
        tuple(signed(column) for column in columns),
        tuple(lines),
        (*_phantom(experiment), *notes.lines()),
    )
    return without_empty_columns(table)


def _measured(row: SeedGroup, column: Column, printed: Values, notes: Notes, with_std: bool) -> Cell:
    """Cell with our mean, where every repetition has the metric, and the paper's number."""
    mean, std = printed.get(column.key, (None, None))
    paper = {"paper": mean, "paper_std": std}
    sample = complete_sample(row, column, notes)
    if sample is None:
        return Cell(**paper)
    value, spread = (number * column.scale for number in mean_and_std(sample))
    interval = cluster_bootstrap(sample)
    notes.interval(row.label, interval)
    return Cell(value, spread if with_std else None, *_limits(interval, column), **paper)


def complete_sample(row: SeedGroup, column: Column, notes: Notes) -> Sample | None:
    """The values of a metric; None (and a note) where a repetition that should have it does not."""
    without = [run.name for run in row.runs if not np.isfinite(run.values(column.key)).any()]
    if without:
        depth_alone = at(row.runs[0].options, "model.normals") == "none" and column.task == "normals"
        if not depth_alone or len(without) < len(row.runs):
            notes.lacks(row.label, ", ".join(without), column.key)
        return None
    sample = sample_of(row.runs, column.key)
    expected = sum(len(run.frames["frame"]) for run in row.runs)
    if len(sample.values) < expected:
        notes.lacks_in(row.label, expected - len(sample.values), expected, column.key)
    return sample


def _difference(row: SeedGroup, base: SeedGroup, column: Column, notes: Notes) -> Cell:
    ours, baseline = complete_sample(row, column, notes), complete_sample(base, column, notes)
    difference = paired_difference(ours, baseline) if ours and baseline else None
    if difference is None:
        return Cell()
    notes.interval(row.label, difference.interval)
    if difference.note:
        notes.add(f"{row.label}: {difference.note}")
    return Cell(difference.mean * column.scale, None, *_limits(difference.interval, column))


def _limits(interval: Interval | None, column: Column) -> tuple[float | None, float | None]:
    return (None, None) if interval is None else (interval.low * column.scale, interval.high * column.scale)


def _comparison(experiment: Experiment, with_paper: bool) -> list[str]:
    """Notes on which data the paper's numbers and ours are of."""
    if not with_paper:
        return _phantom(experiment)
    setting = experiment.setting
    paper_part, our_part = PARTS[SPLIT_PARTS[experiment.name]], PARTS.get(setting.part, setting.part)
    text = f"The paper's numbers are on the {paper_part} split of C3VD"
    if setting.data == "c3vd":
        text += (
            f"; ours on the {our_part} part of split {setting.split}, scored by protocol {setting.protocol}."
        )
    else:
        text += f"; ours on the {our_part} part of the {setting.data}."
    averaged = (
        "" if setting.average == "frame" else "Means are over frames here, whatever the protocol's are."
    )
    return [*_phantom(experiment), text, *([averaged] if averaged else [])]


def _phantom(experiment: Experiment) -> list[str]:
    return [PHANTOM] if experiment.setting.data == "phantom" else []


def _head_names(experiment: Experiment) -> tuple[str, ...]:
    if experiment.name not in TITLES:
        return ("Run", "Model", "Seeds")
    return ("Depth, normals, consistency" if experiment.name == "lambda" else "Method", "Seeds")


def _heads(experiment: Experiment, row: SeedGroup) -> tuple[str, ...]:
    seeds = ", ".join(str(run.summary["seed"]) for run in row.runs)
    if experiment.name not in TITLES:
        return (row.label, label_of(row.runs[0]), seeds)
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

"""Group runs into experiments: the rows of a table, chosen by their options and under one setting."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from col3d.reports.options import Loss, at, differing, fingerprint, loss_of
from col3d.reports.paper_tables import SPLIT_PARTS, ablation_label, lambda_label, methods, paper_table
from col3d.reports.runs import Found, Run
from col3d.reports.setting import Setting, setting_of

DEPTH_ALONE: Loss = (("silog",), (1.0,))
"""Terms of a loss and their weights."""
NORMAL_TERMS = {"normal_l1": "l1", "normal_rmse": "l2"}
"""Loss terms of normals in the ablation, and the paper's names for them."""
OWN_LOSSES: dict[str, Loss] = {
    "bts": DEPTH_ALONE,
    "newcrfs": DEPTH_ALONE,
    "col3d_mtl": (("silog", "normal_l1", "cross_task_rmse"), (0.5, 0.3, 0.2)),
    "pix2pix": (("depth_l1",), (100.0,)),
    "monodepth_fpn": (("rmse_log", "gradient_l1", "gradient_direction"), (1.0, 10.0, 1.0)),
}
"""Each method's own loss, in the benchmark."""
ABLATION: dict[str, tuple[Loss, ...]] = {
    "bts": (DEPTH_ALONE,),
    "bts_cbam": (DEPTH_ALONE,),
    "bts_cbam_mtl": tuple((("silog", n), (0.5, 0.5)) for n in NORMAL_TERMS),
    "col3d_mtl": tuple((("silog", n, "cross_task_rmse"), (0.5, 0.3, 0.2)) for n in NORMAL_TERMS),
}
Label = Callable[[dict[str, Any]], str | None]


@dataclass(frozen=True)
class SeedGroup:
    """The runs of one row: the same options with other seeds."""

    label: str
    runs: tuple[Run, ...]


@dataclass(frozen=True)
class Experiment:
    """Rows of one table.

    Attributes:
        name: benchmark, ablation, lambda, or other_1 and so on.
        left_out: a line for each run that is left out, with the reason.
        notes: options that its rows should share but do not.
    """

    name: str
    setting: Setting
    rows: tuple[SeedGroup, ...]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


def benchmark_row(options: dict[str, Any]) -> str | None:
    """Label of a run in the benchmark: the method, where it is trained with its own loss and heads.

    Scored predictions of another program are a method, too.
    """
    model = str(at(options, "model.name"))
    if at(options, "predictions.folder") is not None:
        return model
    fits = _plain(options) and loss_of(options) == OWN_LOSSES.get(model)
    return methods()[model] if fits else None


def ablation_row(options: dict[str, Any]) -> str | None:
    """Label of a run in the ablation: one of the six configurations of the paper's."""
    model, loss = str(at(options, "model.name")), loss_of(options)
    fits = _plain(options) and loss in ABLATION.get(model, ())
    measured = [NORMAL_TERMS[term] for term in loss[0] if term in NORMAL_TERMS]
    return ablation_label(model, next(iter(measured), None)) if fits else None


def lambda_row(options: dict[str, Any]) -> str | None:
    """Label of a run among the loss weights: Col3D-MTL with normals by L1 and consistency by RMSE."""
    terms, weights = loss_of(options)
    default = OWN_LOSSES["col3d_mtl"][0]
    fits = at(options, "model.name") == "col3d_mtl" and _plain(options) and terms == default
    return lambda_label(weights) if fits else None


def _plain(options: dict[str, Any]) -> bool:
    """Whether a run's heads are the defaults."""
    own = "unc" if at(options, "model.name") in ("bts_cbam_mtl", "col3d_mtl") else "none"
    heads = at(options, "model.normals") in (own, None)
    frame = at(options, "model.normal_frame") in ("camera", None)
    return heads and frame


ROWS: dict[str, tuple[Label, list[str]]] = {
    "benchmark": (benchmark_row, list(paper_table("benchmark"))),
    "ablation": (ablation_row, list(paper_table("ablation"))),
    "lambda": (lambda_row, list(paper_table("lambda"))),
}
"""Table -> the label of a run in it, and the order in which the paper prints its rows."""


def experiments_of(collected: Found) -> list[Experiment]:
    """The paper's tables that the runs fill, then tables of all other runs, one for each setting."""
    tables = [table for name in ROWS if (table := _experiment(name, collected.runs)) is not None]
    shown = {id(run) for table in tables for row in table.rows for run in row.runs}
    return tables + _others([run for run in collected.runs if id(run) not in shown])


def _experiment(name: str, runs: Sequence[Run]) -> Experiment | None:
    label, order = ROWS[name]
    by_setting: dict[Setting, list[Run]] = defaultdict(list)
    for run in runs:
        if label(run.options) is not None:
            by_setting[setting_of(run)].append(run)
    if not by_setting:
        return None
    all_settings = [setting_of(run) for run in runs]
    chosen = max(
        by_setting,
        key=lambda setting: (
            len(by_setting[setting]),
            setting.part == SPLIT_PARTS[name],
            all_settings.count(setting),
            setting.protocol == "standard",
            setting.named,
        ),
    )
    left_out = [
        f"under another setting ({setting.named}): {_names(others)}"
        for setting, others in by_setting.items()
        if setting != chosen
    ]
    rows, row_notes = _rows(by_setting[chosen], label)
    rows.sort(key=lambda row: order.index(row.label) if row.label in order else len(order))
    return Experiment(name, chosen, tuple(rows), (*left_out, *row_notes), tuple(_training(rows)))


def _rows(runs: Sequence[Run], label: Label) -> tuple[list[SeedGroup], list[str]]:
    by_label: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        by_label[str(label(run.options))].append(run)
    rows, notes = [], []
    for name, same_label in by_label.items():
        kept, repeat_notes = _repeats(name, same_label)
        rows.append(kept)
        notes += repeat_notes
    return rows, notes


def _repeats(label: str, runs: Sequence[Run]) -> tuple[SeedGroup, list[str]]:
    """The largest set of runs that differ by their seed alone, and notes on the others."""
    alike: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        alike[fingerprint(run.options)].append(run)
    kept, *rest = sorted(alike.values(), key=len, reverse=True)
    notes = [
        f"{label}, for options differ from those of {kept[0].name} in "
        f"{differing(kept[0].options, others[0].options)}: {_names(others)}"
        for others in rest
    ]
    by_seed: dict[int, Run] = {}
    for run in sorted(kept, key=lambda run: (len(run.folder.parts), run.name)):
        first = by_seed.setdefault(int(run.summary["seed"]), run)
        if first is not run:
            notes.append(f"{label}, for options and seed are those of {first.name}: {run.name}")
    return SeedGroup(label, tuple(by_seed[seed] for seed in sorted(by_seed))), notes


def _training(rows: Sequence[SeedGroup]) -> list[str]:
    """Notes on what rows of a table should share but do not."""
    notes = []
    for option in ("trainer.max_epochs", "preset", "model.width"):
        values = {row.label: at(row.runs[0].options, option) for row in rows}
        if len(set(map(str, values.values()))) > 1:
            notes.append(f"{option} differs: " + ", ".join(f"{k} {v}" for k, v in values.items()))
    counts = {row.label: len(row.runs) for row in rows}
    if len(set(counts.values())) > 1:
        notes.append("Repetitions differ: " + ", ".join(f"{k} {n}" for k, n in counts.items()))
    return notes


def label_of(run: Run) -> str:
    """Name of a run's network: from its registration, from the paper, or the model's name."""
    model = str(run.summary["model"])
    return str(run.summary.get("label") or methods().get(model, model))


def _others(runs: Sequence[Run]) -> list[Experiment]:
    """Runs of no other table, by setting; rows of different options each under the name of its first run."""
    by_setting: dict[Setting, dict[str, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for run in runs:
        by_setting[setting_of(run)][fingerprint(run.options)].append(run)
    tables = []
    for number, (setting, alike) in enumerate(by_setting.items(), start=1):
        pairs = [_repeats(same_options[0].name, same_options) for same_options in alike.values()]
        left_out = tuple(note for _, repeat_notes in pairs for note in repeat_notes)
        rows = tuple(row for row, _ in pairs)
        tables.append(Experiment(f"other_{number}", setting, rows, left_out, ()))
    return tables


def _names(runs: Sequence[Run]) -> str:
    return ", ".join(run.name for run in runs)

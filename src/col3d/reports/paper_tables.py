"""Tables of the Col3D-MTL paper, read from `paper/*.csv`."""

import csv
from functools import cache
from importlib.resources import files

from col3d.registry.metric_specs import OURS

SPLIT_PARTS = {"ablation": "val", "lambda": "val", "benchmark": "test", "per_segment": "test"}
"""Part of the split that each table of the paper is evaluated on."""
Values = dict[str, tuple[float, float | None]]
"""Metric -> mean and, where it is printed, standard deviation; shares of normals in percent, as printed."""


@cache
def paper_table(name: str) -> dict[str, Values]:
    """A table of the paper by the labels of its rows; those of `per_segment` are `segment: method`.

    Args:
        name: ablation, lambda, benchmark or per_segment.
    """
    return {_label(name, row): _values(row) for row in _rows(f"{name}_{SPLIT_PARTS[name]}")}


@cache
def methods() -> dict[str, str]:
    """The paper's name of each network, by the network's name here."""
    return {row["model"]: row["label"] for row in _rows("methods")}


@cache
def training_shares() -> dict[str, float]:
    """Segment -> percent of the training frames, as printed."""
    return {row["segment"]: float(row["train_percent"]) for row in _rows("per_segment_test")}


def _rows(name: str) -> list[dict[str, str]]:
    """Rows of one of the files; metrics have the names that they have in `per_frame.csv`."""
    text = files("col3d.reports").joinpath(f"paper/{name}.csv").read_text("utf-8")
    return list(csv.DictReader(text.splitlines()))


def ablation_label(model: str, normals: str | None) -> str:
    """Label of a row of the ablation, such as `BTS-CBAM-MTL (L1)`."""
    return methods()[model] + (f" ({normals.upper()})" if normals else "")


def lambda_label(lambdas: tuple[float, ...]) -> str:
    """Label of a triple of loss weights, such as `(0.5, 0.3, 0.2)`."""
    return f"({', '.join(f'{weight:g}' for weight in lambdas)})"


def _label(name: str, row: dict[str, str]) -> str:
    if name == "lambda":
        weights = (row["lambda_depth"], row["lambda_normal"], row["lambda_xtc"])
        return lambda_label(tuple(float(weight) for weight in weights))
    if name == "ablation":
        return ablation_label(row["model"], row["normal_loss"] or None)
    label = methods()[row["model"]]
    return f"{row['segment']}: {label}" if name == "per_segment" else label


def _values(row: dict[str, str]) -> Values:
    values: Values = {}
    for column, mean in row.items():
        metric = column if column in OURS else column.removesuffix("_mean")
        if metric in OURS and mean:
            std = row.get(f"{metric}_std")
            values[metric] = (float(mean), float(std) if std else None)
    return values

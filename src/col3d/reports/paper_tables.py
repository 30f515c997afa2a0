"""The numbers that the Col3D-MTL paper prints, carried along as data (`paper/*.csv`)."""

import csv
from functools import cache
from importlib.resources import files

METRICS = {
    "abs_rel": "abs_rel",
    "sq_rel": "sq_rel",
    "log10": "log10",
    "rmse": "rmse",
    "rmse_log": "rmse_log",
    "silog": "silog",
    "d1": "delta1",
    "d2": "delta2",
    "d3": "delta3",
    "mean_ang": "angle_mean",
    "median_ang": "angle_median",
    "a11.25": "within_11_25",
    "a22.5": "within_22_5",
    "a30": "within_30",
}
"""Heading of the paper's tables -> name in `per_frame.csv`."""
SPLIT_PARTS = {"ablation": "val", "lambda": "val", "benchmark": "test", "per_segment": "test"}
"""What the paper evaluates on in each of its tables."""
LABELS = {
    "bts": "BTS",
    "bts_cbam": "BTS-CBAM",
    "bts_cbam_mtl": "BTS-CBAM-MTL",
    "col3d_mtl": "Col3D-MTL",
    "pix2pix": "pix2pix",
    "monodepth_fpn": "MonoDepth+FPN (re-implementation)",
    "newcrfs": "NeWCRFs",
}
Values = dict[str, tuple[float, float | None]]
"""Metric -> mean and, where it is printed, standard deviation; shares of normals in percent, as printed."""


@cache
def paper_table(name: str) -> dict[str, Values]:
    """A table of the paper by the labels of its rows; those of `per_segment` are `segment: method`.

    Args:
        name: ablation, lambda, benchmark or per_segment.
    """
    text = files("col3d.reports").joinpath(f"paper/{name}_{SPLIT_PARTS[name]}.csv").read_text("utf-8")
    return {_label(name, row): _values(row) for row in csv.DictReader(text.splitlines())}


@cache
def training_shares() -> dict[str, float]:
    """Segment -> percent of the training frames, as printed."""
    text = files("col3d.reports").joinpath("paper/per_segment_test.csv").read_text("utf-8")
    return {row["segment"]: float(row["train_percent"]) for row in csv.DictReader(text.splitlines())}


def ablation_label(model: str, normals: str | None) -> str:
    """BTS-CBAM-MTL (L1), for one."""
    return LABELS[model] + (f" ({normals.upper()})" if normals else "")


def lambda_label(lambdas: tuple[float, ...]) -> str:
    """(0.5, 0.3, 0.2), for one."""
    return f"({', '.join(f'{weight:g}' for weight in lambdas)})"


def _label(name: str, row: dict[str, str]) -> str:
    if name == "lambda":
        weights = (row["lambda_depth"], row["lambda_normal"], row["lambda_xtc"])
        return lambda_label(tuple(float(weight) for weight in weights))
    if name == "ablation":
        return ablation_label(row["model"], row["normal_loss"] or None)
    label = LABELS[row["model"]]
    return f"{row['segment']}: {label}" if name == "per_segment" else label


def _values(row: dict[str, str]) -> Values:
    values: Values = {}
    for printed, metric in METRICS.items():
        if mean := row.get(printed) or row.get(f"{printed}_mean"):
            std = row.get(f"{printed}_std")
            values[metric] = (float(mean), float(std) if std else None)
    return values

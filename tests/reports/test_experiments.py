"""Which runs form which table: by options alone, under one setting, repetitions by their seeds."""

from pathlib import Path
from typing import Any

import pytest
from fake_runs import CONSISTENT, VIDEOS, options_of, with_rmse, write_paper, write_run

from col3d.registry.earlier import updated
from col3d.reports.experiments import (
    Experiment,
    ablation_row,
    benchmark_row,
    experiments_of,
    lambda_row,
)
from col3d.reports.options import fingerprint
from col3d.reports.page import tables_of
from col3d.reports.paper_tables import paper_table
from col3d.reports.runs import read_runs

BY_L1 = {**CONSISTENT, "consistency": {"term": "cross_task_l1"}}
PINHOLE = {**CONSISTENT, "consistency": {"term": "cross_task_rmse", "geometry": "pinhole"}}


def tables(root: Path) -> dict[str, Experiment]:
    return {table.name: table for table in experiments_of(read_runs(root))}


@pytest.mark.parametrize(
    ("model", "changes", "benchmark", "ablation", "weights"),
    [
        ("bts", {}, "BTS", "BTS", None),
        ("bts", {"model__normals": "unc"}, None, None, None),
        ("bts", {"loss__terms": {"depth": {"term": "depth_l1"}}}, None, None, None),
        ("bts_cbam", {}, None, "BTS-CBAM", None),
        ("bts_cbam_mtl", {}, None, "BTS-CBAM-MTL (L1)", None),
        ("bts_cbam_mtl", {"loss__terms": with_rmse("bts_cbam_mtl")}, None, "BTS-CBAM-MTL (L2)", None),
        ("bts_cbam_mtl", {"loss__lambdas": [0.6, 0.4]}, None, None, None),
        ("col3d_mtl", {}, "Col3D-MTL", "Col3D-MTL (L1)", "(0.5, 0.3, 0.2)"),
        ("col3d_mtl", {"loss__terms": with_rmse("col3d_mtl")}, None, "Col3D-MTL (L2)", None),
        ("col3d_mtl", {"loss__lambdas": [0.4, 0.3, 0.3]}, None, None, "(0.4, 0.3, 0.3)"),
        ("col3d_mtl", {"loss__terms": BY_L1}, None, None, None),
        ("col3d_mtl", {"loss__terms": PINHOLE}, None, None, None),
        ("col3d_mtl", {"model__normal_frame": "ray"}, None, None, None),
        ("newcrfs", {}, "NeWCRFs", None, None),
        ("pix2pix", {}, "pix2pix", None, None),
        ("monodepth_fpn", {}, "MonoDepth+FPN (re-implementation)", None, None),
    ],
)
def test_rows_are_told_from_options(
    model: str, changes: dict[str, Any], benchmark: str | None, ablation: str | None, weights: str | None
) -> None:
    options = options_of(model, 3, **changes)
    assert (benchmark_row(options), ablation_row(options), lambda_row(options)) == (
        benchmark,
        ablation,
        weights,
    )


def test_options_that_older_runs_lack_count_as_defaults() -> None:
    options = options_of("col3d_mtl")
    options["loss"] = {"depth": "silog", "normals": "l1", "consistency": "rmse", "lambdas": [0.5, 0.3, 0.2]}
    del options["model"]["normals"], options["model"]["normal_frame"]
    assert benchmark_row(updated(options)) == "Col3D-MTL"


def test_rows_stand_in_the_papers_order_with_their_seeds(tmp_path: Path) -> None:
    found = tables(write_paper(tmp_path, seeds=(2, 0)))
    assert list(found) == ["benchmark", "ablation", "lambda"]
    for name in ("benchmark", "ablation"):
        assert [row.label for row in found[name].rows] == list(paper_table(name))
    assert [row.label for row in found["lambda"].rows] == ["(0.4, 0.3, 0.3)", "(0.5, 0.3, 0.2)"]
    assert {tuple(r.summary["seed"] for r in row.runs) for t in found.values() for row in t.rows} == {(0, 2)}
    assert all(not table.left_out and not table.notes for table in found.values())


@pytest.mark.parametrize(
    "changes",
    [
        {"facts": {"protocol": "published"}},
        {"facts": {"split": "val"}},
        {"facts": {"data": "c3vd"}},
        {"facts": {"split_name": "segments"}},
        {"facts": {"average": "pixel"}},
        {"frames": 5},
        {"videos": list(VIDEOS)[:3]},
        {"data__size": [64, 64]},
        {"first": 1},
        {"facts": {"size": [64, 64]}},
        {"data__split": {"name": "paper", "train": ["cecum_t1_a"], "test": list(VIDEOS)}},
    ],
    ids=str,
)
def test_another_setting_is_named_and_stands_apart(tmp_path: Path, changes: dict[str, Any]) -> None:
    write_run(tmp_path / "pix_0", "pix2pix", 0)
    write_run(tmp_path / "crf_0", "newcrfs", 0)
    write_run(tmp_path / "odd", "newcrfs", 1, **changes)
    found = tables(tmp_path)
    assert [[run.name for run in row.runs] for row in found["benchmark"].rows] == [["pix_0"], ["crf_0"]]
    (line,) = found["benchmark"].left_out
    assert line.startswith("under another setting (")
    assert line.endswith(": odd")
    assert [run.name for row in found["other_1"].rows for run in row.runs] == ["odd"]
    assert found["other_1"].setting != found["benchmark"].setting


def test_most_runs_decide_and_the_papers_part_among_equals(tmp_path: Path) -> None:
    for model in ("bts", "bts_cbam"):
        write_run(tmp_path / model, model)
        write_run(tmp_path / model, model, evaluation="evaluation_val", facts={"split": "val"})
    found = tables(tmp_path)
    assert found["ablation"].setting.part == "val"
    assert found["benchmark"].setting.part == "test"
    write_run(tmp_path / "bts_1", "bts", 1)
    assert tables(tmp_path)["ablation"].setting.part == "test"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model__width": 512}, r"model.width (128, 512): wide"),
        ({"trainer__max_epochs": 2}, "max_epochs (10, 2)"),
    ],
)
def test_other_options_are_no_repetition(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    for seed in (0, 1):
        write_run(tmp_path / f"bts_{seed}", "bts", seed)
    write_run(tmp_path / "wide", "bts", 2, **change)
    found = tables(tmp_path)
    (row,) = found["benchmark"].rows
    assert [run.name for run in row.runs] == ["bts_0", "bts_1"]
    assert words in found["benchmark"].left_out[0]
    assert [row.label for row in found["other_1"].rows] == ["wide"]


def test_where_a_run_was_written_does_not_matter(tmp_path: Path) -> None:
    write_run(tmp_path / "a", "bts", 0)
    write_run(tmp_path / "b", "bts", 1, variant="bts", preset="mine", overwrite=True, data__root="/elsewhere")
    (row,) = tables(tmp_path)["benchmark"].rows
    assert [run.name for run in row.runs] == ["a", "b"]


def test_a_seed_counts_once(tmp_path: Path) -> None:
    write_run(tmp_path / "a" / "b", "bts", 0)
    write_run(tmp_path / "z", "bts", 0)
    write_run(tmp_path / "z", "bts", 0, evaluation="evaluation_test")
    (row,) = tables(tmp_path)["benchmark"].rows
    assert [run.name for run in row.runs] == ["z"]
    assert tables(tmp_path)["benchmark"].left_out == (
        "BTS, for options and seed are those of z: a/b",
        "BTS, for options and seed are those of z: z/evaluation_test",
    )


def test_rows_trained_for_longer_are_said(tmp_path: Path) -> None:
    write_run(tmp_path / "a", "bts")
    write_run(tmp_path / "b", "pix2pix", trainer__max_epochs=40)
    write_run(tmp_path / "c", "pix2pix", 1, trainer__max_epochs=40)
    assert tables(tmp_path)["benchmark"].notes == (
        "trainer.max_epochs differs: pix2pix 40, BTS 10",
        "Repetitions differ: pix2pix 2, BTS 1",
    )


def test_runs_of_no_table_have_one_of_their_own(tmp_path: Path) -> None:
    for seed in (0, 1):
        write_run(tmp_path / f"unc_{seed}", "bts", seed, model__normals="unc")
    (only,) = tables(tmp_path).values()
    assert only.name == "other_1"
    assert [[run.name for run in row.runs] for row in only.rows] == [["unc_0", "unc_1"]]


def test_a_callback_makes_another_training_and_pictures_do_not() -> None:
    plain = {"model": {"name": "bts"}, "callbacks": {"panels": 1, "more": {}}, "seed": 0}
    averaged = {**plain, "callbacks": {"panels": 1, "more": {"ema": {"callback": "EMAWeightAveraging"}}}}
    pictured = {**plain, "callbacks": {"panels": 9, "predictions": True}, "seed": 1}
    assert fingerprint(averaged) != fingerprint(plain)
    assert fingerprint(pictured) == fingerprint(plain)


def test_predictions_of_another_program_stand_beside_the_methods(tmp_path: Path) -> None:
    for seed in (0, 1):
        write_run(tmp_path / f"bts_{seed}", "bts", seed)
    files = {"folder": "/data/theirs", "unit": 1000.0}
    theirs = {"model": "theirs", "label": "theirs"}
    write_run(tmp_path / "theirs", worse=0.5, facts=theirs, model__name="theirs", predictions=files)
    benchmark = experiments_of(read_runs(tmp_path))[0]
    assert [row.label for row in benchmark.rows] == ["BTS", "theirs"]
    table = tables_of([benchmark])[0]
    assert [row.heads[0] for row in table.rows] == ["BTS", "theirs"]

"""What counts as a finished run, and the words for everything that does not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_runs import METRICS, change_summary, write_run

from col3d.reports.per_frame import IDENTITY, read_per_frame, write_per_frame
from col3d.reports.runs import read_runs


def test_columns_are_arrays_in_order(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "a" / "b", "bts", videos=("trans_t3_b", "cecum_t2_a"))
    table = folder / "per_frame.csv"
    rows = read_per_frame(table)
    write_per_frame(table, rows[::-1])
    (run,) = read_runs(tmp_path).runs
    assert run.name == "a/b"
    assert run.frames["video"].tolist() == ["cecum_t2_a"] * 6 + ["trans_t3_b"] * 6
    assert run.frames["frame"].tolist() == [*range(6), *range(6)]
    assert run.frames["abs_rel"][0] == float(rows[6]["abs_rel"])
    assert np.isnan(run.frames["angle_mean"]).all()
    assert run.frames["pixels"].tolist() == [*range(1000, 1006)] * 2
    assert run.options["model"]["name"] == run.summary["model"] == "bts"


def test_the_folder_itself_may_be_a_run(tmp_path: Path) -> None:
    write_run(tmp_path / "mine")
    assert [run.name for run in read_runs(tmp_path / "mine").runs] == ["mine"]


def test_columns_that_older_tables_lack_are_empty(tmp_path: Path) -> None:
    table = write_run(tmp_path / "old") / "per_frame.csv"
    columns = (*IDENTITY, *METRICS)
    rows = [{name: row[name] for name in columns} for row in read_per_frame(table)]
    table.write_text("\n".join(",".join(line) for line in (columns, *(r.values() for r in rows))) + "\n")
    (run,) = read_runs(tmp_path).runs
    assert np.isnan(run.values("delta_1_1")).all()
    assert np.isnan(run.frames["pixels"]).all()
    assert np.isfinite(run.frames["abs_rel"]).all()


def test_an_evaluation_takes_the_options_of_its_run(tmp_path: Path) -> None:
    write_run(tmp_path / "a", model__width=192)
    write_run(tmp_path / "a", evaluation="evaluation_val", facts={"split": "val"})
    found = read_runs(tmp_path)
    assert [run.name for run in found.runs] == ["a", "a/evaluation_val"]
    assert [run.options["model"]["width"] for run in found.runs] == [192, 192]
    assert found.left_out == ()


def rewrite(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        path = folder / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, 1))

    return change


def lose(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def cut(name: str, share: float) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        (folder / name).write_text(text[: int(len(text) * share)])

    return change


def first_value(text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        rows = read_per_frame(folder / "per_frame.csv")
        rows[3]["rmse"] = text
        write_per_frame(folder / "per_frame.csv", rows)

    return change


def same_frame_twice(folder: Path) -> None:
    rows = read_per_frame(folder / "per_frame.csv")
    rows[3]["frame"] = rows[2]["frame"]
    write_per_frame(folder / "per_frame.csv", rows)


def of_another_seed(folder: Path) -> None:
    rows = read_per_frame(folder / "per_frame.csv")
    rows[3]["seed"] = "7"
    write_per_frame(folder / "per_frame.csv", rows)


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lose("summary.json"), ("not finished", "summary.json ")),
        (lose("per_frame.csv"), ("not finished", "per_frame.csv ")),
        (lose("config.yaml"), ("summary.json ", "config.yaml: ")),
        (cut("summary.json", 0.5), ("summary.json is ", "broken")),
        (cut("per_frame.csv", 0.5), ("per_frame.csv ",)),
        (rewrite("config.yaml", "model:", "model: ["), ("config.yaml ", "read")),
        (rewrite("config.yaml", "loss:", "lost:"), ("config.yaml ", "model, loss, data")),
        (rewrite("per_frame.csv", "texture", "surprise"), ("per_frame.csv ", "columns texture")),
        (lambda folder: change_summary(folder, seed=None, frames=None), ("summary.json ", "seed, frames")),
        (lambda folder: change_summary(folder, frames=25), ("24 frames", "summary.json says 25")),
        (
            lambda folder: change_summary(folder, protocol="native"),
            ("protocol standard", "summary.json has native"),
        ),
        (first_value("nan"), ("rmse ", "frame 3 of cecum_t2_a", "1 values")),
        (first_value("inf"), ("rmse ", "frame 3 of cecum_t2_a")),
        (first_value("much"), ("per_frame.csv ", "'much'")),
        (same_frame_twice, ("per_frame.csv ", "frame 2 of cecum_t2_a twice")),
        (of_another_seed, ("per_frame.csv ", "seed 7", "summary.json has 0")),
    ],
)
def test_what_is_left_out_says_why(
    tmp_path: Path, spoil: Callable[[Path], None], named: tuple[str, ...]
) -> None:
    write_run(tmp_path / "whole")
    spoil(write_run(tmp_path / "spoilt"))
    found = read_runs(tmp_path)
    assert [run.name for run in found.runs] == ["whole"]
    (line,) = found.left_out
    assert line.startswith("spoilt: ")
    assert all(part in line for part in named), line


def test_other_weights_and_unfinished_runs_are_named(tmp_path: Path) -> None:
    write_run(tmp_path / "a")
    write_run(tmp_path / "a", evaluation="evaluation_last_test", facts={"checkpoint": "/x/last.ckpt"})
    write_run(tmp_path / "b")
    write_run(tmp_path / "b", evaluation="evaluation_test")
    (tmp_path / "b" / "summary.json").unlink()
    assert read_runs(tmp_path).left_out == (
        "a/evaluation_last_test: scores /x/last.ckpt, not the best weights of its run",
        "b: not finished, summary.json is missing",
        "b/evaluation_test: an evaluation of b, which is not finished",
    )


def test_folders_of_other_programs_are_no_runs(tmp_path: Path) -> None:
    write_run(tmp_path / "a")
    for inside in ("wandb/offline-run-1/files", ".hydra"):
        (tmp_path / "a" / inside).mkdir(parents=True)
        (tmp_path / "a" / inside / "config.yaml").write_text("wandb_version: 1\n")
    found = read_runs(tmp_path)
    assert [run.name for run in found.runs] == ["a"]
    assert found.left_out == ()

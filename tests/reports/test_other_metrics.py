"""Metrics that this package does not know, and runs that lack some: what tables and notes say of them."""

import csv
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_runs import change_summary, write_run

from col3d.reports.compose import further_table, main_table
from col3d.reports.experiments import experiments_of
from col3d.reports.page import tables_of
from col3d.reports.per_frame import read_per_frame
from col3d.reports.render import latex, markdown
from col3d.reports.runs import read_runs
from col3d.reports.tables import Table, marks

SPEC = {"better": "higher", "unit": "%", "heading": "Sharp & clear", "decimals": 1, "scale": 100.0}


def add(folder: Path, name: str, values: Mapping[int, Any], spec: dict[str, Any] | None = None) -> None:
    """Add a column to the table of a run, by the places of rows, and perhaps what is said of it."""
    path = folder / "per_frame.csv"
    rows = [{**row, name: values.get(i, "")} for i, row in enumerate(read_per_frame(path))]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    if spec is not None:
        change_summary(folder, metric_specs={name: spec})


def tables(root: Path) -> dict[str, Table]:
    found = read_runs(root)
    assert found.left_out == ()
    return {table.name: table for table in tables_of(experiments_of(found))}


def cell(table: Table, row: str, key: str) -> Any:
    line = next(line for line in table.rows if line.heads[0] == row)
    return line.cells[[column.key for column in table.columns].index(key)]


def test_a_metric_of_a_plugin_has_its_heading_unit_and_direction(tmp_path: Path) -> None:
    for model, share in (("bts", 0.25), ("newcrfs", 0.5)):
        add(write_run(tmp_path / model, model), "sharp", dict.fromkeys(range(24), share), SPEC)
    table = tables(tmp_path)["benchmark"]
    assert [column.key for column in table.columns][-1] == "sharp"
    assert cell(table, "BTS", "sharp").value == pytest.approx(25.0)
    assert [of_row[-1] for of_row in marks(table)] == ["best", "second"]
    assert "| Sharp & clear (%) ↑ |" in markdown(table)
    assert "| **50.0 ± 0.0** |" in markdown(table)
    assert r"& Sharp \& clear $\uparrow$ \\" in latex(table)
    assert "sharp" in [column.key for column in tables(tmp_path)["benchmark_videos"].columns]
    differences = tables(tmp_path)["benchmark_differences"]
    assert cell(differences, "NeWCRFs", "sharp").value == pytest.approx(25.0)


def test_a_column_that_nobody_knows_is_shown_under_its_name_and_none_is_best(tmp_path: Path) -> None:
    for model, value in (("bts", 1.0), ("newcrfs", 2.0)):
        add(write_run(tmp_path / model, model), "speed", dict.fromkeys(range(24), value))
        add(tmp_path / model, "remark", dict.fromkeys(range(24), "blurred"))
    table = tables(tmp_path)["benchmark"]
    assert [column.key for column in table.columns][-1] == "speed"
    assert [of_row[-1] for of_row in marks(table)] == ["", ""]
    assert "| speed |" in markdown(table)


def test_one_note_says_which_runs_lack_what_others_have(tmp_path: Path) -> None:
    for model in ("bts", "newcrfs", "pix2pix"):
        write_run(tmp_path / model, model)
    for name in ("sharp", "clear"):
        add(tmp_path / "bts", name, dict.fromkeys(range(24), 0.5))
    notes = tables(tmp_path)["benchmark"].notes
    lacking = [note for note in notes if "does not have it" in note]
    assert lacking == [
        "pix2pix, NeWCRFs: sharp, clear left empty, for per_frame.csv of pix2pix, newcrfs does not have it."
    ]


def test_what_nobody_has_is_no_lack(tmp_path: Path) -> None:
    write_run(tmp_path / "bts")
    table = tables(tmp_path)["benchmark"]
    assert not [note for note in table.notes if "does not have" in note]
    assert "benchmark_further" not in tables(tmp_path)


def test_ours_beyond_the_paper_stand_in_a_table_of_their_own(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "bts")
    write_run(tmp_path / "newcrfs", "newcrfs")
    add(folder, "far_rmse", dict.fromkeys(range(20), 4.0))
    add(folder, "mae", dict.fromkeys(range(24), 2.0))
    add(folder, "within_5", dict.fromkeys(range(24), 0.5))
    experiment = experiments_of(read_runs(tmp_path))[0]
    assert not {"mae", "far_rmse", "within_5"} & {column.key for column in main_table(experiment).columns}
    table = further_table(experiment)
    assert table is not None
    assert table.title == "Benchmark: further metrics"
    assert [column.key for column in table.columns] == ["mae", "far_rmse", "within_5"]
    assert cell(table, "BTS", "within_5").value == pytest.approx(50.0)
    assert "BTS: 4 of 24 frames have no far_rmse and are not in its mean." in table.notes


def test_values_that_are_no_numbers_drop_no_run(tmp_path: Path) -> None:
    """A metric that a frame need not have; of errors of depth a number is expected."""
    folder = write_run(tmp_path / "bts")
    add(folder, "sharp", {**dict.fromkeys(range(23), 0.5), 23: "nan"}, SPEC)
    (run,) = read_runs(tmp_path).runs
    assert np.isnan(run.values("sharp")).tolist() == [False] * 23 + [True]
    assert "BTS: 1 of 24 frames have no sharp and are not in its mean." in tables(tmp_path)["benchmark"].notes


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ({"better": "up"}, r"metric_specs\.sharp\.better"),
        ({"decimals": -3}, r"metric_specs\.sharp\.decimals"),
        ({"scale": "much"}, r"metric_specs\.sharp\.scale"),
        ({"heading": 3}, r"metric_specs\.sharp\.heading"),
        ("lower", r"metric_specs\.sharp"),
    ],
)
def test_a_broken_spec_is_named(tmp_path: Path, spec: Any, said: str) -> None:
    change_summary(write_run(tmp_path / "a"), metric_specs={"sharp": spec})
    (line,) = read_runs(tmp_path).left_out
    assert re.match(rf"a: summary\.json is broken: {said}", line)


def test_specs_and_reports_need_no_torch() -> None:
    """A report is written where nothing can be trained."""
    check = "import sys, col3d.reports.__main__, col3d.reports.figures; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0

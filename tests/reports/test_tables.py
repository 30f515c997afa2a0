"""Tables of known numbers, as every format prints them."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from fake_runs import DEPTH_METRICS, change_summary, options_of, write_paper, write_run

from col3d.reports.breakdowns import cost_table, segment_table, video_table
from col3d.reports.compose import PHANTOM, difference_tables, main_table
from col3d.reports.experiments import Experiment, experiments_of
from col3d.reports.paper_tables import paper_table, training_shares
from col3d.reports.render import comma_separated, escape, latex, markdown
from col3d.reports.runs import read_runs
from col3d.reports.shares import training_frames
from col3d.reports.statistics import cluster_bootstrap, sample_of
from col3d.reports.tables import METRICS, Cell, Line, Table, marks

SMALL = Table(
    "small",
    "Small & plain",
    "Two metrics.",
    ("Method",),
    (METRICS["rmse"], METRICS["within_30"]),
    (
        Line(("a_1",), (Cell(1.5, 0.25, 1.0, 2.0, 4.994), Cell(71.758))),
        Line(("b",), (Cell(-1.0), Cell(71.7581))),
        Line(("c",), (Cell(2.0), Cell())),
    ),
    ("50 % | half",),
)


def tables(root: Path) -> dict[str, Experiment]:
    return {table.name: table for table in experiments_of(read_runs(root))}


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Experiment]:
    return tables(write_paper(tmp_path_factory.mktemp("runs")))


def test_markdown() -> None:
    assert markdown(SMALL).splitlines() == [
        "### Small & plain",
        "",
        "Two metrics.",
        "",
        "| Method | RMSE (mm) ↓ | < 30° (%) ↑ |",
        "| --- | ---: | ---: |",
        "| a_1 | <u>1.500 ± 0.250</u> | **71.758** |",
        "| 95 % interval | [1.000, 2.000] |  |",
        "| in the paper | 4.994 |  |",
        "| b | **\N{MINUS SIGN}1.000** | **71.758** |",
        "| c | 2.000 | \N{EN DASH} |",
        "",
        "* 50 % \\| half",
    ]


def test_latex() -> None:
    assert latex(SMALL).splitlines() == [
        r"% needs \usepackage{booktabs,graphicx}",
        r"\begin{table*}[t]",
        r"\centering",
        r"\caption{Small \& plain. Two metrics. 50 \% | half}",
        r"\label{tab:small}",
        r"\resizebox{\textwidth}{!}{%",
        r"\begin{tabular}{lcc}",
        r"\toprule",
        r"\textbf{Method} & RMSE $\downarrow$ & $\delta_{30^\circ}$ $\uparrow$ \\",
        r"\midrule",
        r"a\_1 & \underline{1.500 $\pm$ 0.250} & \textbf{71.758} \\",
        r"{\scriptsize 95 \% interval} & {\scriptsize [1.000, 2.000]} &  \\",
        r"{\scriptsize in the paper} & {\scriptsize 4.994} &  \\",
        r"b & \textbf{$-$1.000} & \textbf{71.758} \\",
        r"c & 2.000 & -- \\",
        r"\bottomrule",
        r"\end{tabular}}",
        r"\end{table*}",
    ]


def test_csv_has_plain_numbers_in_columns_of_their_own() -> None:
    assert comma_separated(SMALL).splitlines() == [
        "method,rmse,rmse_std,rmse_low,rmse_high,rmse_paper,within_30_percent",
        "a_1,1.5,0.25,1.0,2.0,4.994,71.758",
        "b,-1.0,,,,,71.7581",
        "c,2.0,,,,,",
    ]


def test_best_is_by_what_is_printed_and_within_a_group() -> None:
    assert marks(SMALL) == [["second", "best"], ["best", "best"], ["", ""]]
    values = [("x", 1.0), ("x", 2.0), ("y", 3.0), ("z", 5.0), ("z", 4.0)]
    rows = tuple(Line((group,), (Cell(value),)) for group, value in values)
    grouped = Table("t", "t", "", ("Segment",), (METRICS["delta1"],), rows, grouped=True)
    assert marks(grouped) == [["second"], ["best"], [""], ["best"], ["second"]]


def test_special_signs_are_escaped() -> None:
    assert escape(r"a_b & 5 % {x} ~^\ #$") == (
        r"a\_b \& 5 \% \{x\} \textasciitilde{}\textasciicircum{}\textbackslash{} \#\$"
    )


def test_every_latex_table_is_balanced(paper: dict[str, Experiment]) -> None:
    made = [
        main_table(paper["ablation"]),
        segment_table(paper["benchmark"]),
        *difference_tables(paper["lambda"]),
    ]
    for table in made:
        assert table is not None
        text = latex(table)
        bare = re.sub(r"\\[{}]", "", text)
        assert bare.count("{") == bare.count("}")
        assert re.findall(r"\\begin\{(.*?)\}", text) == re.findall(r"\\end\{(.*?)\}", text)[::-1]
        assert text.isascii()
        lines = [line for line in text.splitlines() if line.endswith(r"\\")]
        assert {len(re.findall(r"(?<!\\)&", line)) for line in lines} == {
            len(table.heads + table.columns) - 1
        }


def test_ours_and_the_papers_stand_side_by_side(paper: dict[str, Experiment]) -> None:
    table = main_table(paper["benchmark"])
    row = next(row for row in table.rows if row.heads == ("Col3D-MTL", "0, 1"))
    cell = row.cells[[column.key for column in table.columns].index("rmse")]
    runs = next(row.runs for row in paper["benchmark"].rows if row.label == "Col3D-MTL")
    values = np.concatenate([run.frames["rmse"] for run in runs])
    interval = cluster_bootstrap(sample_of(runs, "rmse"))
    assert interval is not None
    assert (cell.value, cell.std) == pytest.approx((values.mean(), values.std()))
    assert (cell.low, cell.high, cell.paper, cell.paper_std) == (interval.low, interval.high, 3.052, 1.143)
    assert PHANTOM in table.notes
    assert (
        "The paper's numbers are on the test split of C3VD; ours on the test part of the phantom."
        in table.notes
    )
    weights = main_table(paper["lambda"]).notes
    assert any("on the validation split of C3VD; ours on the test part" in note for note in weights)


def test_shares_of_normals_are_in_percent(paper: dict[str, Experiment]) -> None:
    table = main_table(paper["ablation"])
    j = [column.key for column in table.columns].index("within_30")
    runs = paper["ablation"].rows[4].runs
    assert table.rows[4].cells[j].value == pytest.approx(100 * sample_of(runs, "within_30").values.mean())
    interval = cluster_bootstrap(sample_of(runs, "within_30"))
    assert interval is not None
    limits = (table.rows[4].cells[j].low, table.rows[4].cells[j].high)
    assert limits == pytest.approx((100 * interval.low, 100 * interval.high))
    assert table.rows[4].cells[j].paper == 71.758
    assert table.rows[0].cells[j] == Cell()


def test_differences_are_on_the_same_frames(paper: dict[str, Experiment]) -> None:
    (table,) = difference_tables(paper["benchmark"])
    assert [row.heads[0] for row in table.rows] == [row for row in paper_table("benchmark") if row != "BTS"]
    ours, base = (paper["benchmark"].rows[i].runs[0].frames["abs_rel"] for i in (4, 3))
    both = (paper["benchmark"].rows[i].runs[1].frames["abs_rel"] for i in (4, 3))
    expected = np.mean([(ours - base).mean(), np.subtract(*both).mean()])
    cell = table.rows[3].cells[0]
    assert cell.value == pytest.approx(expected)
    assert cell.low is not None
    assert cell.high is not None
    assert cell.low < expected < cell.high < 0
    assert {mark for of_row in marks(table) for mark in of_row} == {""}
    assert [t.name for t in difference_tables(paper["ablation"])] == [
        "ablation_differences",
        "ablation_differences_normals",
    ]


def test_segments_with_their_share_of_the_training(paper: dict[str, Experiment]) -> None:
    table = segment_table(paper["benchmark"])
    assert table is not None
    assert [row.heads[:2] for row in table.rows[::5]] == [
        ("cecum", "75 % (paper 43 %)"),
        ("transverse", "25 % (paper 36 %)"),
        ("sigmoid", "0 % (paper 21 %)"),
        ("descending", "0 % (paper 0 %)"),
    ]
    assert (table.rows[9].cells[0].paper, table.rows[9].cells[0].paper_std) == (6.412, 0.490)
    assert list(training_shares().values()) == [43.0, 36.0, 21.0, 0.0]


def test_shares_of_the_papers_split_of_c3vd_are_the_papers() -> None:
    cecum, sigmoid = ["c1v1", "c2v2", "c2v3", "c3v2"], ["s1v3", "s2v1"]
    transverse = ["t1v1", "t1v3", "t2v1", "t2v2", "t3v2", "t4v1", "t4v3"]
    split = {"name": "paper", "train": cecum + sigmoid + transverse}
    frames = training_frames(options_of(data__name="c3vd", data__split=split, data__release="pre_2023_05"))
    assert frames is not None
    assert sum(frames.values()) == 6344
    shares = {name: float(round(100 * n / 6344)) for name, n in frames.items()}
    assert {"descending": 0.0, **shares} == training_shares()
    now = training_frames(options_of(data__name="c3vd", data__split=split))
    assert now is not None
    assert sum(now.values()) == 6244
    assert training_frames(options_of(data__split={"name": "mine", "train": ["attic"]})) is None


def test_videos_are_shown_one_by_one(paper: dict[str, Experiment]) -> None:
    table = video_table(paper["ablation"])
    assert [row.heads[0] for row in table.rows[::6]] == [
        "cecum_t2_a",
        "trans_t3_b",
        "sigmoid_t3_b",
        "desc_t4_a",
    ]
    frames = paper["ablation"].rows[0].runs[0].frames
    both = [run.frames["abs_rel"][frames["video"] == "trans_t3_b"] for run in paper["ablation"].rows[0].runs]
    assert table.rows[6].cells[0].value == pytest.approx(np.mean(both))


def test_costs(tmp_path: Path) -> None:
    write_run(tmp_path / "a", "bts", 0)
    write_run(tmp_path / "b", "bts", 1)
    change_summary(write_run(tmp_path / "c", "newcrfs", 0), cost=None)
    table = cost_table(experiments_of(read_runs(tmp_path)))
    assert [row.heads for row in table.rows] == [("NeWCRFs", "128 x 160"), ("BTS", "128 x 160")]
    assert table.rows[0].cells == (Cell(12.0), Cell(), Cell())
    assert table.rows[1].cells == (Cell(12.0), Cell(9.5), Cell(20.5, 0.5))
    assert "NeWCRFs: left empty, for gflop is not in summary.json of c" in table.notes


def test_a_metric_that_one_repetition_lacks_is_left_empty(tmp_path: Path) -> None:
    write_run(tmp_path / "new", "bts", 0)
    old = write_run(tmp_path / "old", "bts", 1) / "per_frame.csv"
    rows = list(csv.reader(old.read_text().splitlines()))
    strict = rows[0].index("delta_1_1")
    old.write_text("".join(",".join(v for i, v in enumerate(row) if i != strict) + "\n" for row in rows))
    write_run(tmp_path / "crf", "newcrfs", 0)
    table = main_table(tables(tmp_path)["benchmark"])
    j = [column.key for column in table.columns].index("delta_1_1")
    assert [row.cells[j].value is None for row in table.rows] == [False, True]
    assert "BTS: delta_1_1 left empty, for per_frame.csv of old does not have it." in table.notes
    assert "Intervals (NeWCRFs): over videos, there being one seed." in table.notes


def test_frames_without_a_value_are_counted(tmp_path: Path) -> None:
    path = write_run(tmp_path / "a", "bts") / "per_frame.csv"
    rows = list(csv.reader(path.read_text().splitlines()))
    rows[1][rows[0].index("rmse")] = ""
    path.write_text("".join(",".join(row) + "\n" for row in rows))
    table = main_table(tables(tmp_path)["benchmark"])
    assert "BTS: 1 of 24 frames have no rmse and are not in its mean." in table.notes


def test_one_video_and_one_seed_have_no_interval(tmp_path: Path) -> None:
    write_run(tmp_path / "a", "bts", videos=("cecum_t2_a",))
    table = main_table(tables(tmp_path)["benchmark"])
    assert all(cell.low is None for cell in table.rows[0].cells)
    assert "No interval: one video and one seed." in table.notes


def test_the_papers_tables_are_whole() -> None:
    sizes = {name: len(paper_table(name)) for name in ("ablation", "lambda", "benchmark", "per_segment")}
    assert sizes == {"ablation": 6, "lambda": 8, "benchmark": 5, "per_segment": 20}
    assert paper_table("lambda")["(0.4, 0.3, 0.3)"]["angle_mean"] == (22.957, None)
    assert paper_table("ablation")["BTS"].keys() == set(DEPTH_METRICS)

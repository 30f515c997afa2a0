"""The report as a reader gets it: from the command line, and in a browser."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from fake_runs import change_summary, write_paper, write_run
from refusals import refusal

from col3d.reports import figures
from col3d.reports.__main__ import main
from col3d.reports.templating import data_uri

PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c6360000000020001"
    "48afa4710000000049454e44ae426082"
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All of the paper's runs, an old one, one cut off, and one under another protocol."""
    root = write_paper(tmp_path_factory.mktemp("runs"))
    change_summary(root / "bts_0", command=None, commit=None, cost=None)
    write_run(root / "odd", "bts", 5, facts={"protocol": "published"})
    write_run(root / "cut <off>")
    (root / "cut <off>" / "summary.json").write_text('{"model": ')
    return root


@pytest.fixture(scope="module")
def out(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "new"
    assert main([str(runs), str(folder)]) == 0
    return folder


def test_the_command_needs_no_torch(runs: Path, tmp_path: Path) -> None:
    code = (
        "import runpy, sys; sys.argv[0] = 'reports'\n"
        "try:\n    runpy.run_module('col3d.reports', run_name='__main__')\n"
        "except SystemExit as end:\n    assert not end.code, end.code\n"
        "found = {'torch', 'lightning', 'wandb', 'torchmetrics'} & set(sys.modules)\n"
        "assert not found, found"
    )
    arguments = [sys.executable, "-c", code, str(runs), str(tmp_path)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "report.html") in done.stdout
    assert "note: left out: cut <off>: summary.json is half written or broken" in done.stdout


def test_every_table_is_a_file_of_each_kind(out: Path) -> None:
    stems = {path.stem for path in (out / "tables").glob("*.md")}
    assert {"benchmark", "benchmark_differences", "benchmark_segments", "benchmark_videos"} < stems
    assert {"ablation", "lambda", "other_1", "cost"} < stems
    for ending in ("tex", "csv"):
        assert {path.stem for path in (out / "tables").glob(f"*.{ending}")} == stems


def test_the_page_needs_nothing_beside_it(out: Path) -> None:
    text = (out / "report.html").read_text()
    for word in ("http://", "https://", "@import", '<link rel="stylesheet'):
        assert word not in text
    assert text.count("src=") == text.count('src="data:image/png;base64,')
    assert text.count("href=") == text.count('href="#') + text.count('href="data:,"')


@pytest.mark.parametrize("name", ["report.html", "report.md"])
def test_all_is_said(out: Path, name: str) -> None:
    text = (out / name).read_text()
    for words in (
        "A phantom is not C3VD: these numbers compare runs on the phantom and nothing else",
        "Left out",
        "summary.json is half written or broken",
        "python train.py model=col3d_mtl seed=1",
        "abc1234",
        "torch 2.14.1",
        "not recorded",
        "frames_per_video: 24",
        "protocol published",
        "left empty, for gflop is not in summary.json of bts_0",
    ):
        assert words in text, words
    assert ("cut &lt;off&gt;" in text) == name.endswith("html")


def test_what_is_not_there_is_not_announced(tmp_path: Path) -> None:
    write_run(tmp_path / "runs" / "a", facts={"data": "c3vd"})
    assert main([str(tmp_path / "runs"), str(tmp_path / "out")]) == 0
    for name in ("report.html", "report.md"):
        text = (tmp_path / "out" / name).read_text()
        assert "phantom is not" not in text
        assert "Left out" not in text


def test_figures_stand_in_the_page(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(found: Any, folder: Path, truth: Path | None) -> figures.Drawn:
        folder.mkdir(parents=True)
        (folder / "a.png").write_bytes(PIXEL)
        drawn = figures.Figure("Errors", "By <depth>.", folder / "a.png")
        return figures.Drawn((drawn,), ("figure 'Frames': there is no truth",))

    monkeypatch.setattr(figures, "draw", draw)
    assert main([str(runs), str(tmp_path)]) == 0
    text = (tmp_path / "report.html").read_text()
    assert f'src="{data_uri(tmp_path / "figures" / "a.png")}"' in text
    assert "By &lt;depth&gt;." in text
    assert "figure &#39;Frames&#39;: there is no truth" in text
    markdown = (tmp_path / "report.md").read_text()
    assert "![Errors](figures/a.png)" in markdown
    assert "* not drawn: figure 'Frames': there is no truth" in markdown


def test_a_protocol_can_be_chosen(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(runs), str(tmp_path), "--protocol", "published"]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "### odd" in text
    assert "* bts_0: scored under protocol standard, not published" in text
    assert main([str(runs), str(tmp_path), "--protocol", "native"]) == 2
    complaint = refusal(capsys.readouterr().err)
    assert complaint.about == "--protocol"
    assert "'native'" in complaint.message
    assert "published, standard" in complaint.message


def test_bad_input_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "empty").mkdir()
    write_run(tmp_path / "good" / "a")
    for arguments, named in (
        (("nowhere", "out"), f"{tmp_path / 'nowhere'} is no folder"),
        (("empty", "out"), f" in {tmp_path / 'empty'}"),
        (("good", "file"), f"{tmp_path / 'file'} is a file"),
    ):
        assert main([str(tmp_path / name) for name in arguments]) == 2
        assert named in refusal(capsys.readouterr().err).message
    assert not (tmp_path / "out").exists()


def column(browser: Any, table: str, number: int) -> list[str]:
    cells = browser.find_elements("css selector", f"#{table} tbody tr > :nth-child({number})")
    return [cell.get_attribute("data-value") or cell.text for cell in cells]


def click(browser: Any, table: str, number: int) -> str:
    head = browser.find_element("css selector", f"#{table} thead th:nth-child({number})")
    browser.execute_script("arguments[0].querySelector('button').click()", head)
    return str(head.get_attribute("aria-sort"))


def test_the_page_loads_without_a_complaint(browser: Any, out: Path) -> None:
    browser.get((out / "report.html").as_uri())
    assert browser.find_element("css selector", "h1").text.startswith("Report on")
    assert len(browser.find_elements("css selector", "table.sortable")) == len(
        list((out / "tables").glob("*.md"))
    )
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    wide = browser.execute_script("return document.documentElement.scrollWidth > window.innerWidth")
    assert not wide


def test_a_click_on_a_heading_sorts(browser: Any, out: Path) -> None:
    browser.get((out / "report.html").as_uri())
    before = column(browser, "benchmark", 3)
    assert click(browser, "benchmark", 3) == "ascending"
    values = [float(value) for value in column(browser, "benchmark", 3)]
    assert values == sorted(map(float, before)) != list(map(float, before))
    assert click(browser, "benchmark", 3) == "descending"
    assert [float(value) for value in column(browser, "benchmark", 3)] == values[::-1]
    assert click(browser, "benchmark", 1) == "ascending"
    names = column(browser, "benchmark", 1)
    assert names == sorted(names, key=str.lower)
    sorts = browser.find_elements(
        "css selector", "#benchmark th[aria-sort=ascending], #benchmark th[aria-sort=descending]"
    )
    assert len(sorts) == 1


@pytest.mark.parametrize("clicks", [1, 2])
def test_rows_without_a_number_come_last(browser: Any, out: Path, clicks: int) -> None:
    browser.get((out / "report.html").as_uri())
    number = len(browser.find_elements("css selector", "#ablation thead th"))
    for _ in range(clicks):
        click(browser, "ablation", number)
    values = column(browser, "ablation", number)
    assert values[-2:] == ["\N{EN DASH}"] * 2
    assert all(value.replace(".", "").isdigit() for value in values[:-2])

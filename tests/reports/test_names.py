"""Names stand on screen and in reports as they are, whatever rich, Markdown or HTML would make of them."""

import json
from pathlib import Path

import pytest
from fake_runs import write_run

from col3d.io.run_files import STATUS
from col3d.reports.__main__ import main
from col3d.reports.ledger import main as ledger
from col3d.reports.render import as_code, as_text
from col3d.reports.runs import read_runs
from col3d.reports.summary import print_summary

NAMES = ("z[b]x", "[red]y", "[/]", ":smile:", "<b>bold</b>")


@pytest.mark.parametrize("name", NAMES)
def test_on_screen(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_run(tmp_path / "runs" / "a", facts={"data": name, "protocol": name}, videos=("cecum_t2_a",))
    (run,) = read_runs(tmp_path / "runs").runs
    print_summary({**run.summary, "videos": {name: run.summary["videos"]["cecum_t2_a"]}})
    said = capsys.readouterr().out
    assert f"Depth: bts on {name}, test split, seed 0, protocol {name}" in said
    assert f"\n {name} " in said
    status = {"state": "failed", "error": f"{name}: no such thing"}
    folder = tmp_path / "sweep" / name.replace("/", "-")
    folder.mkdir(parents=True)
    (folder / STATUS).write_text(json.dumps(status))
    assert ledger([str(tmp_path / "sweep")]) == 0
    said = capsys.readouterr().out
    assert folder.name in said
    assert f"{name}: no such thing" in said


def test_in_a_report(tmp_path: Path) -> None:
    write_run(tmp_path / "z[b]x*y*" / "in `<b>` _c_", facts={"command": "python `train.py` ``x``"})
    (tmp_path / "z[b]x*y*" / "cut [off](a)").mkdir()
    (tmp_path / "z[b]x*y*" / "cut [off](a)" / "config.yaml").write_text("a: 1")
    assert main([str(tmp_path / "z[b]x*y*"), str(tmp_path / "out")]) == 0
    text = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "z\\[b\\]x\\*y\\*" in text
    assert "### in \\`\\<b\\>\\` \\_c\\_\n" in text
    assert "* cut \\[off\\](a): " in text
    assert "* command: ``` python '`train.py`' '``x``' ```\n" in text
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "in `&lt;b&gt;` _c_" in page


def test_words_of_the_field_stay_readable() -> None:
    assert as_text("bts_cbam_mtl, 95 % interval, 3.5 mm") == "bts_cbam_mtl, 95 % interval, 3.5 mm"
    assert as_code("python train.py model=bts") == "`python train.py model=bts`"

"""Files of runs whose JSON is of another shape are broken, and no reader of them ends in a traceback."""

import copy
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from fake_runs import write_run
from refusals import refused

from col3d.errors import UserError
from col3d.io.ownership import Owned
from col3d.io.run_files import RESULT, STATUS, add_to_plan, read_plain, read_sweep
from col3d.reports.experiments import experiments_of
from col3d.reports.ledger import main as ledger
from col3d.reports.page import write_report
from col3d.reports.run_page import write_run_page
from col3d.reports.runs import read_runs
from col3d.reports.summary import print_summary
from col3d.runs.status import JobStatus

WRONG = (None, [], {}, "x", [[1]], {"x": {"x": []}}, True, -1, 10**400, float("inf"), [{}], {"x": "y"})
STATUSES = {
    "state": "running",
    "seconds": 61.5,
    "epoch": 2,
    "epochs": 5,
    "sessions": 1,
    "process": 7,
    "host": "node3",
    "error": "",
    "started": "2026-01-01",
}


def mutations(content: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """The same with one thing replaced, at the top or one level down; and things that are no object."""
    yield from (("all of it", wrong) for wrong in WRONG)
    for key, value in content.items():
        for wrong in WRONG:
            yield key, content | {key: wrong}
            if isinstance(value, dict) and value:
                inside = copy.deepcopy(value)
                inside[next(iter(inside))] = wrong
                yield f"inside {key}", content | {key: inside}


@pytest.mark.end_to_end
def test_every_reader_of_a_summary(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "runs" / "bts_0", frames=2)
    write_run(tmp_path / "runs" / "bts_1", seed=1, frames=2)
    whole, path, usable = json.loads((folder / "summary.json").read_text()), folder / "summary.json", 0
    for _, content in mutations(whole):
        path.write_text(json.dumps(content))
        found = read_runs(tmp_path / "runs")
        assert len(found.runs) + len(found.left_out) == 2
        usable += len(found.runs) == 2
        write_report(tmp_path / "out", found, experiments_of(found), (), (), "runs")
        if summary := read_plain(path):
            print_summary(summary)
        with suppress(UserError):
            write_run_page(folder)
    assert usable
    path.write_text("[" * 100_000)
    assert "broken" in read_runs(tmp_path / "runs").left_out[0]
    with refused(UserError, None, "summary.json ", "(nested too deeply)"):
        write_run_page(folder)


@pytest.mark.parametrize(
    ("name", "content"),
    [(STATUS, STATUSES), (RESULT, {"best": {"val/abs_rel": 0.1}}), ("sweep.json", {"jobs": {"a": ["b=1"]}})],
)
def test_every_reader_of_a_job(
    name: str, content: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep, folder = tmp_path, tmp_path / "job"
    folder.mkdir()
    (folder / STATUS).write_text(json.dumps(STATUSES))
    path = sweep / name if name == "sweep.json" else folder / name
    Owned(sweep, "sweep", "hydra.sweep.dir").adopt("sweep.json")
    for _, wrong in mutations(content):
        path.write_text(json.dumps(wrong))
        assert "job" in [job.name for job in read_sweep(sweep)]
        assert ledger([str(sweep)]) == 0
        assert JobStatus(folder).seconds >= 0
        add_to_plan(sweep, {"c": ["d=1"]}, "again")
        assert "c" in read_plain(sweep / "sweep.json")["jobs"]
    assert "job" in capsys.readouterr().out

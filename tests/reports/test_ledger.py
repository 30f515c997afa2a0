"""The ledger tells what became of every job, from the files of their folders alone."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from refusals import refusal

from col3d.io.run_files import LOCK, PLAN, STATES, add_to_plan, read_sweep
from col3d.reports.ledger import main

HOLD = """
import fcntl, sys, time
with open(sys.argv[1], "w") as file:
    fcntl.lockf(file, fcntl.LOCK_EX)
    print(flush=True)
    time.sleep(60)
"""
"""A process that holds a lock, after it has said so."""


def job(sweep: Path, name: str, state: str | None, result: bool = False, **facts: Any) -> Path:
    folder = sweep / name
    folder.mkdir()
    if state is not None:
        (folder / "status.json").write_text(json.dumps({"state": state, **facts}))
    if result:
        (folder / "result.json").write_text(json.dumps({"best": {"val/abs_rel": 0.1234567}}))
    return folder


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    job(tmp_path, "a_done", "done", result=True, epoch=5, epochs=5, seconds=3725.0)
    job(tmp_path, "b_running", "running", epoch=2, epochs=5, seconds=61.0, process=7, host="node3")
    job(tmp_path, "c_cut", "running", epoch=1, epochs=5)
    job(tmp_path, "d_preempted", "preempted")
    job(tmp_path, "e_failed", "failed", error="optimizer.lr: too [high]")
    (tmp_path / "f_broken").mkdir()
    (tmp_path / "f_broken" / "status.json").write_text("{")
    (tmp_path / "figures").mkdir()
    add_to_plan(tmp_path, {"a_done": ["seed=0"], "g_missing": ["seed=9"]}, "train.py -m seed=0,9")
    return tmp_path


def test_every_state_is_told(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, "-c", HOLD, str(sweep / "b_running" / LOCK)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        states = {found.name: found.state for found in read_sweep(sweep)}
        assert main([str(sweep)]) == 0
        holder.kill()
    assert states == {
        "a_done": "done",
        "b_running": "running",
        "c_cut": "cut off",
        "d_preempted": "preempted",
        "e_failed": "failed",
        "f_broken": "missing",
        "g_missing": "missing",
    }
    assert set(states.values()) == set(STATES)
    shown = capsys.readouterr().out
    for text in ("5/5", "1 h 02 min", "0.1235", "process 7 on node3", "optimizer.lr: too [high]"):
        assert text in shown
    assert "1 done, 1 running, 1 preempted, 1 cut off, 1 failed, 2 missing" in shown
    assert {found.state for found in read_sweep(sweep) if found.name == "b_running"} == {"cut off"}


def test_plans_of_several_commands_add_up(tmp_path: Path) -> None:
    add_to_plan(tmp_path, {"a": ["seed=0"]}, "train.py seed=0")
    add_to_plan(tmp_path, {"a": ["seed=0"], "b": ["seed=1"]}, "train.py seed=0,1")
    add_to_plan(tmp_path, {"a": ["seed=0"]}, "train.py seed=0")
    plan = json.loads((tmp_path / PLAN).read_text())
    assert plan == {
        "commands": ["train.py seed=0", "train.py seed=0,1"],
        "jobs": {"a": ["seed=0"], "b": ["seed=1"]},
    }


def test_what_is_no_sweep_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for place, reason in ((tmp_path, "holds no job"), (tmp_path / "none", "is no folder")):
        assert main([str(place)]) == 2
        assert f"{place} {reason}" in refusal(capsys.readouterr().err).message

"""Two processes learn what one does with the doubled batch, and score every frame once, to the bit."""

import csv
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from programs import PROJECT, call
from tiny_run import SMALL, TINY

from col3d.io.run_files import read_plain
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
DDP = ["trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu"]
FOUR = ["data.split.train=[cecum_t1_a,trans_t1_a:0-0]", "trainer.max_epochs=2", "model=bts", SMALL]
"""Four frames to train on, which two processes share without seeing one twice."""
TOLERANCE = 0.05
"""Of losses: each process has statistics of its own batch, and SILog a mean error of its own."""


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_losses_are_those_of_the_doubled_batch(tiny: Compose, tmp_path: Path) -> None:
    train(tiny(*FOUR, "data.batch_size=4"))
    place = [f"data.root={tiny()['data']['root']}", f"hydra.run.dir={tmp_path / 'both'}"]
    answer = call("train.py", *TINY, *FOUR, *DDP, "data.batch_size=2", *place, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    alone, both = rows(tmp_path / "run"), rows(tmp_path / "both")
    assert [row["step"] for row in alone] == [row["step"] for row in both]
    for one, other in zip(alone, both, strict=True):
        assert one["train/lr"] == other["train/lr"]
        assert one["train/frames_without_truth"] == other["train/frames_without_truth"]
        for name in ("train/loss", "val/loss", "val/abs_rel"):
            assert float(one[name]) == pytest.approx(float(other[name]), rel=TOLERANCE), name
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in ("run", "both")]
    assert summaries[0]["baseline"] == pytest.approx(summaries[1]["baseline"], rel=1e-12)
    assert "sync_dist" not in answer.stderr


def test_the_same_weights_score_the_same(tiny: Compose, tmp_path: Path) -> None:
    train(tiny("model=bts", SMALL, "data.batch_size=1"))
    alone, both = tmp_path / "run", tmp_path / "both"
    shutil.copytree(alone, both)
    for name in ("result.json", "summary.json", "per_frame.csv"):
        (both / name).unlink()
    last = torch.load(both / "checkpoints" / "last.ckpt", weights_only=True)
    last["hyper_parameters"]["options"]["trainer"] |= {"devices": 2, "strategy": "ddp", "accelerator": "cpu"}
    torch.save(last, both / "checkpoints" / "last.ckpt")
    place = [f"data.root={tiny()['data']['root']}", f"hydra.run.dir={both}"]
    answer = call("train.py", *TINY, *DDP, "model=bts", SMALL, "data.batch_size=1", *place, cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    assert "epoch 1/1" not in answer.stdout
    assert (both / "per_frame.csv").read_text() == (alone / "per_frame.csv").read_text()
    found, expected = (json.loads((run / "result.json").read_text())["metrics"] for run in (both, alone))
    assert found == expected


def test_both_save_and_leave_and_go_on_to_the_same_weights(tiny: Compose, tmp_path: Path) -> None:
    train(tiny("model=bts", SMALL))  # renders
    root = tiny()["data"]["root"]

    def command(name: str) -> list[str]:
        place = [f"data.root={root}", f"hydra.run.dir={tmp_path / name}"]
        return [
            "train.py",
            *TINY,
            *DDP,
            "model=bts",
            SMALL,
            "trainer.max_epochs=8",
            "data.batch_size=1",
            *place,
        ]

    assert call(*command("whole"), cwd=tmp_path).returncode == 0
    script, *arguments = command("cut")
    process = subprocess.Popen(
        [sys.executable, str(PROJECT / script), *arguments],
        cwd=tmp_path,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.DEVNULL,
    )
    while read_plain(tmp_path / "cut" / "status.json").get("epoch", 0) < 2:
        time.sleep(0.05)
    process.terminate()
    assert process.wait() == 143
    assert read_plain(tmp_path / "cut" / "status.json")["state"] == "preempted"
    assert call(*command("cut"), cwd=tmp_path).returncode == 0
    found, expected = (
        torch.load(tmp_path / name / "checkpoints" / "last.ckpt", weights_only=True)["state_dict"]
        for name in ("cut", "whole")
    )
    assert all(torch.equal(found[name], expected[name]) for name in expected)
    for name in ("metrics.csv", "per_frame.csv"):
        assert (tmp_path / "cut" / name).read_text() == (tmp_path / "whole" / name).read_text()

"""Protocols of other papers in an evaluation: what they measure, what they say, and one fit a video."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from tiny_run import composed
from torch import Tensor

from col3d.batch import Prediction
from col3d.evaluation.evaluate import evaluate
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.evaluation.scorer import Scoring, score
from col3d.metrics import Protocol
from col3d.reports.per_frame import read_per_frame

PAPERS = ("endostreamdepth", "ppsnet", "simcol3d", "moge_scale", "moge_affine", "moge_disparity")


@pytest.mark.filterwarnings("ignore:.*pin_memory.*")
def test_each_measures_what_its_program_does_and_says_how(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkpoint = shutil.copy(tiny_checkpoint, tmp_path / "best.ckpt")
    place = (f"checkpoint={checkpoint}", f"root={phantom_root}", f"output_dir={tmp_path / 'scored'}")
    names = ("standard", *PAPERS)
    options = composed("evaluate", *place, f"protocol=[{','.join(names)}]", "workers=0", "panels=0")
    evaluate(options)
    for name in names:
        summary = json.loads((tmp_path / "scored" / name / "summary.json").read_text())
        own = options["protocol"][name]
        if own["metrics"] is not None:
            far = {metric for metric in own["metrics"] if metric.startswith("far_")}  # no pixel is that far
            assert {*own["metrics"]} - {*summary["metrics"]} <= far
            rows = read_per_frame(tmp_path / "scored" / name / "per_frame.csv")
            assert not {*rows[0]} & {"delta_1_1", "angle_mean"}
        assert list(summary["scoring"]) == ["mask", "alignment", "truth", "average"]
        assert (summary["scoring"]["alignment"] == "none") == (own["scaling"] == "none")
        assert summary["frames_without_truth"] == 0
    shown = capsys.readouterr().out
    assert "alignment: a factor, of the frames' means, for each video" in shown
    assert "alignment: a factor and an offset of inverse depth, by least squares, for each frame" in shown


def test_a_video_is_fitted_whole_wherever_batches_end(tmp_path: Path) -> None:
    """Of three videos, in batches that hold frames of two."""
    videos, factors = ["a", "a", "a", "b", "b", "c"], torch.tensor([2.0, 1.0, 0.5, 3.0, 1.0, 4.0])
    truth = torch.arange(1, 7).view(6, 1, 1, 1).float().expand(6, 1, 4, 5) * 10

    def predicted(size: int) -> Iterator[tuple[Any, dict[None, Prediction]]]:
        for start in range(0, 6, size):
            part = slice(start, start + size)
            batch = {"depth": truth[part], "mask": truth[part] > 0, "frame": torch.arange(6)[part]}
            depth: Tensor = truth[part] * factors[part].view(-1, 1, 1, 1)
            yield batch | {"video": videos[part]}, {None: {"depth": depth}}

    found = {}
    for size in (1, 2, 4, 6):
        table = PerFrameTable(tmp_path / "rows.csv", {}, lambda video: ("", ""), ["l1_cm"])
        protocol = Protocol("simcol3d", "means", scaling_over="video", names=("l1_cm",))
        score(predicted(size), [Scoring(protocol, table)], torch.tensor(25.0))
        found[size] = [row["l1_cm"] for row in table.rows]
        assert [row["l1_cm"] for row in table.baseline][-1] == pytest.approx(0, abs=1e-6)
    expected = []
    for video in "abc":
        frames = [i for i, name in enumerate(videos) if name == video]
        guess, true = (truth[frames, 0, 0, 0] * factors[frames]).double(), truth[frames, 0, 0, 0].double()
        factor = (guess * true).sum() / guess.square().sum()
        expected += ((factor * guess - true).abs() / 10).tolist()
    for values in found.values():
        assert values == pytest.approx(expected, rel=1e-6, abs=1e-6)

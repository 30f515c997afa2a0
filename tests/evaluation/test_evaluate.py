"""Published weights scored as they are, and trained ones on other data."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from parity import needs_parity, published_state
from refusals import refused
from tiny_run import composed

from col3d.errors import UserError
from col3d.evaluation.evaluate import evaluate
from col3d.training.train import train

pytestmark = pytest.mark.filterwarnings("ignore:.*pin_memory.*")
Compose = Callable[..., dict[str, Any]]
PHANTOM = (
    "data=phantom",
    "data/split=custom",
    "data.split.train=[cecum_t1_a]",
    "data.split.val=[trans_t1_a:1-2]",
    "data.split.test=[desc_t4_a,trans_t1_a:2-2]",
    "phantom.size=[64,80]",
    "phantom.frames_per_video=3",
    "data.size=[64,64]",
    "data.batch_size=2",
    "data.workers=0",
)


def score(checkpoint: Path, *overrides: str) -> dict[str, Any]:
    """The summary of an evaluation."""
    folder = checkpoint.parent / "scored"
    place = (f"checkpoint={checkpoint}", f"output_dir={folder}", "accelerator=cpu", "panels=1")
    evaluate(composed("evaluate", *place, *overrides))
    file = folder / "summary.json"
    summary: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {}
    return summary


@needs_parity
@pytest.mark.parametrize("source", ["col3d_mtl", "newcrfs"])
def test_an_authors_checkpoint_is_scored_as_it_is(source: str, phantom_root: Path, tmp_path: Path) -> None:
    path = tmp_path / "weights"
    torch.save({"model": {f"module.{n}": v for n, v in published_state(source).items()}}, path)
    summary = score(path, f"published={source}", *PHANTOM, f"data.root={phantom_root}")
    assert (summary["model"], summary["data"], summary["frames_by_split"]) == (source, "phantom", {"test": 4})
    assert ("angle_mean" in summary["metrics"]) == (source == "col3d_mtl")
    others = ["mirrored", "published", "median_scaled", "scale_and_shift", "native"]
    score(
        path, f"published={source}", f"protocol=[{','.join(others)}]", *PHANTOM, f"data.root={phantom_root}"
    )
    seen = {summary["metrics"]["abs_rel"]}
    for name in others:
        other = json.loads((tmp_path / "scored" / name / "summary.json").read_text())
        assert other["protocol"] == name
        seen.add(other["metrics"]["abs_rel"])
    assert len(seen) == 6


def test_a_trained_checkpoint_on_other_frames(tiny: Compose, phantom_root: Path, tmp_path: Path) -> None:
    train(tiny())
    path = tmp_path / "run" / "checkpoints" / "best.ckpt"
    summary = score(path, *PHANTOM, f"data.root={phantom_root}", "data.split.test=[trans_t1_a]")
    assert summary["frames_by_split"] == {"test": 3}


def test_a_protocol_that_counts_nothing_is_refused_before_the_first_is_scored(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    checkpoint = shutil.copy(tiny_checkpoint, tmp_path / "best.ckpt")
    options = ("protocol=[standard,native]", "protocol.native.truth_range=[99.5,99.9]")
    with refused(UserError, "data.split.test", "protocol native", "99.5 and 99.9 mm"):
        score(checkpoint, *PHANTOM, f"data.root={phantom_root}", *options)
    assert list(tmp_path.iterdir()) == [checkpoint]


@pytest.mark.parametrize(
    ("content", "overrides", "about", "named"),
    [
        ({"a": torch.zeros(1)}, ["published=bts"], "data", "published"),
        ({"a": torch.zeros(1)}, ["published=bts", *PHANTOM], "checkpoint", "weights of bts; it has a"),
        ({"a": torch.zeros(1)}, ["published=btz"], "published", "'bts'"),
        ({"a": torch.zeros(1)}, [], "checkpoint", "published="),
        (torch.nn.Linear(1, 1), ["published=bts", *PHANTOM], "checkpoint", "plain values"),
    ],
)
def test_each_mistake_is_one_line(
    content: Any, overrides: list[str], about: str, named: str, phantom_root: Path, tmp_path: Path
) -> None:
    torch.save(content, tmp_path / "weights")
    root = [f"data.root={phantom_root}"] if PHANTOM[0] in overrides else []
    with refused(UserError, about, named) as refusal:
        score(tmp_path / "weights", *overrides, *root)

    assert "\n" not in str(refusal.value)

"""The mean training depth, beside the weights of a checkpoint or, as in those of before, among them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from cut_runs import options, stopped_in
from refusals import refused
from tiny_run import composed

from col3d.errors import UserError
from col3d.evaluation.evaluate import evaluate
from col3d.inference.export.export import export
from col3d.inference.trained_network import located, trained_network
from col3d.runs.trained import mean_depth
from col3d.training.tasks import SupervisedTask
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
KEY = "depth_seen"


def as_before(path: Path) -> None:
    """Rewrite a checkpoint as earlier versions wrote it."""
    content = torch.load(path, weights_only=True)
    content["state_dict"][KEY] = content.pop(KEY)
    torch.save(content, path)


def test_it_is_no_weight(tiny_checkpoint: Path) -> None:
    content = torch.load(tiny_checkpoint, weights_only=True)
    found = trained_network(tiny_checkpoint)
    task = SupervisedTask(found.network)
    assert KEY not in {*task.state_dict(), *dict(task.named_buffers()), *content["state_dict"]}
    total, number = content[KEY].tolist()
    mean = mean_depth(found.depth_seen)
    assert mean is not None
    assert mean.item() == pytest.approx(total / number)
    assert 1 < total / number < 100


def test_a_checkpoint_of_before_has_it_among_its_weights(tiny_checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "before.ckpt"
    path.write_bytes(tiny_checkpoint.read_bytes())
    as_before(path)
    expected = trained_network(tiny_checkpoint)
    found = trained_network(path)
    assert torch.equal(found.depth_seen, expected.depth_seen)
    exported = tmp_path / "half.ckpt"
    export(composed("export", f"checkpoint={path}", f"output={exported}"))
    again = trained_network(exported)
    assert torch.equal(again.depth_seen, expected.depth_seen)


def test_what_ships_has_it() -> None:
    content = torch.load(located(Path("shipped")), weights_only=True)
    kept = content["state_dict"].get(KEY, content.get(KEY))
    found = trained_network(Path("shipped"))
    assert torch.equal(found.depth_seen, kept.double())
    assert found.depth_seen[1] > 0


@pytest.mark.parametrize("value", [None, torch.zeros(3), torch.tensor([torch.nan, 1.0]), "x"])
def test_what_is_no_sum_and_number_is_refused(value: Any, tiny_checkpoint: Path, tmp_path: Path) -> None:
    content = torch.load(tiny_checkpoint, weights_only=True)
    path = tmp_path / "some.ckpt"
    torch.save({**content, KEY: value}, path)
    with refused(UserError, "checkpoint", path, KEY):
        trained_network(path)


def test_a_run_of_before_goes_on_to_the_same_baseline(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seldom = "callbacks.checkpoint_minutes=60"
    train(options(tiny, tmp_path / "whole", seldom))
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", 1, 1, 15)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "cut", seldom))
    for path in (tmp_path / "cut" / "checkpoints").glob("*.ckpt"):
        as_before(path)
    train(options(tiny, tmp_path / "cut", seldom))
    assert baseline(tmp_path / "cut") == baseline(tmp_path / "whole")
    for name in ("per_frame.csv", "metrics.csv"):
        assert (tmp_path / "cut" / name).read_text() == (tmp_path / "whole" / name).read_text()


def baseline(folder: Path) -> dict[str, float]:
    """Scores of the mean depth."""
    found: dict[str, float] = json.loads((folder / "summary.json").read_text())["baseline"]
    assert found["abs_rel"] > 0
    return found


def test_evaluation_compares_with_it(tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path) -> None:
    scores = []
    for name in ("now", "before"):
        path = tmp_path / f"{name}.ckpt"
        path.write_bytes(tiny_checkpoint.read_bytes())
        if name == "before":
            as_before(path)
        given = (f"checkpoint={path}", f"root={phantom_root}", "accelerator=cpu", "panels=0")
        evaluate(composed("evaluate", *given, f"output_dir={tmp_path / name}"))
        scores.append(baseline(tmp_path / name))
    assert scores[0] == scores[1]


def test_a_task_begins_without_it() -> None:
    assert mean_depth(SupervisedTask(torch.nn.Linear(1, 1)).depth_seen) is None

"""Callbacks by name join a training, which goes on after a kill as if there had been none."""

import csv
import signal
from collections.abc import Callable
from pathlib import Path
from statistics import mean
from typing import Any

import pytest
import torch
from cut_runs import SCORING, gone_on, options, stopped_in
from programs import call
from refusals import refusal, refused
from tiny_run import TINY, composed

from col3d.errors import OptionError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.registry import CALLBACKS, available, register_callback
from col3d.training.callback_options import callback_entries, callbacks_of
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
SELDOM = "callbacks.checkpoint_minutes=60"
EMA = ("++callbacks.more.ema.callback=EMAWeightAveraging", "++callbacks.more.ema.decay=0.5")
STOP = (
    "++callbacks.more.stop.callback=EarlyStopping",
    "++callbacks.more.stop.monitor=val/abs_rel",
    "++callbacks.more.stop.patience=1",
    "++callbacks.more.stop.min_delta=100.0",
)


def kept(folder: Path, name: str = "last") -> dict[str, Any]:
    content: dict[str, Any] = torch.load(folder / "checkpoints" / f"{name}.ckpt", weights_only=True)
    return content


def column(path: Path, name: str) -> list[float]:
    return [float(row[name]) for row in csv.DictReader(path.read_text().splitlines()) if row[name]]


@pytest.mark.parametrize(
    ("where", "epoch", "batch", "more"),
    [
        ("on_train_batch_start", 1, 1, EMA),
        ("validation_step", 1, 0, EMA),
        ("validation_step", 2, 1, EMA),
        ("on_train_batch_start", 2, 0, ("++callbacks.more.mean=WeightAveraging",)),
        (SCORING, 2, 0, STOP),
        ("on_train_batch_start", 1, 0, STOP),
    ],
)
def test_a_run_with_callbacks_goes_on_to_the_bit(
    where: str,
    epoch: int,
    batch: int,
    more: tuple[str, ...],
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut = gone_on(monkeypatch, tiny, tmp_path, where, epoch, batch, SELDOM, "data.batch_size=1", *more)
    found, expected = kept(cut), kept(tmp_path / "whole")
    for key in {"current_model_state", "averaging_state"} & expected.keys():
        torch.testing.assert_close(found[key], expected[key], rtol=0, atol=0)
    assert ("current_model_state" in expected) == (more is not STOP)


def test_what_is_averaged_is_validated_kept_tested_and_evaluated(
    tiny: Compose, tmp_path: Path, phantom_root: Path
) -> None:
    run = tmp_path / "run"
    train(options(tiny, run, *EMA, "trainer.max_epochs=2"))
    best = kept(run, "best")
    average, learning = best["state_dict"], best["current_model_state"]
    changed = [name for name in average if not torch.equal(average[name], learning[name])]
    assert "network.encoder.net.conv_stem.weight" in changed
    assert "depth_seen" not in average
    path = run / "checkpoints" / "best.ckpt"
    torch.save({**best, "state_dict": learning}, tmp_path / "learning.ckpt")

    def scored(checkpoint: Path, part: str) -> list[float]:
        place = (f"output_dir={tmp_path / part / checkpoint.stem}", f"root={phantom_root}", f"split={part}")
        evaluate(composed("evaluate", f"checkpoint={checkpoint}", "accelerator=cpu", "panels=0", *place))
        return column(tmp_path / part / checkpoint.stem / "per_frame.csv", "abs_rel")

    assert column(run / "per_frame.csv", "abs_rel") == pytest.approx(scored(path, "test"), rel=1e-6)
    logged = min(column(run / "metrics.csv", "val/abs_rel"))
    assert logged == pytest.approx(mean(scored(path, "val")), rel=1e-6)
    assert logged != pytest.approx(mean(scored(tmp_path / "learning.ckpt", "val")), rel=1e-5)


def test_a_training_stops_where_a_metric_stands_still(tiny: Compose, tmp_path: Path) -> None:
    run = tmp_path / "run"
    given = options(tiny, run, *STOP, "trainer.max_epochs=6")
    train(given)
    assert kept(run)["epoch"] == 1
    best = (run / "checkpoints" / "best.ckpt").read_bytes()
    train(given)
    assert (run / "checkpoints" / "best.ckpt").read_bytes() == best


def test_callbacks_make_another_run_and_their_absence_none(tiny: Compose, tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(options(tiny, run, "trainer.max_epochs=1"))
    train(options(tiny, run, "trainer.max_epochs=1", "callbacks.panels=1", SELDOM))
    with refused(UserError, None, f"{run} holds ", "another callbacks.more;", "overwrite=true"):
        train(options(tiny, run, "trainer.max_epochs=1", *EMA))


@pytest.mark.parametrize("name", available("callback"))
def test_each_that_is_offered_is_built_from_plain_values(name: str) -> None:
    needed = {"EarlyStopping": {"monitor": "val/loss"}, "Timer": {"duration": "00:01:00:00"}}
    [made] = callbacks_of(callback_entries({"one": {"callback": name, **needed.get(name, {})}}))
    assert type(made).__name__ == name


def test_what_lightning_has_is_offered_or_refused_with_a_reason() -> None:
    import lightning.pytorch.callbacks as theirs

    assert {*available("callback"), *CALLBACKS.refused} == {*theirs.__all__}


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        ({"a": "EarlyStoping"}, "callbacks.more", ("'EarlyStoping'", "'EarlyStopping'")),
        ({"a": "ModelCheckpoint"}, "callbacks.more", ("ModelCheckpoint ", "best.ckpt and last.ckpt")),
        (
            {"a": "StochasticWeightAveraging"},
            "callbacks.more",
            ("StochasticWeightAveraging ", " WeightAveraging"),
        ),
        ({"a": "EarlyStopping"}, "callbacks.more.a.monitor", ("needed",)),
        (
            {"a": {"callback": "EarlyStopping", "monitor": "x", "patence": 3}},
            "callbacks.more.a.patence",
            ("'callbacks.more.a.patience'",),
        ),
        (
            {"a": {"callback": "EMAWeightAveraging", "decay": "much"}},
            "callbacks.more.a.decay",
            ("number", "'much'"),
        ),
        (
            {"a": {"callback": "EarlyStopping", "monitor": "x", "mode": "up"}},
            "callbacks.more.a",
            ("EarlyStopping: ", "min, max", "got up"),
        ),
        ({"a": 3}, "callbacks.more.a", ("{callback: NAME, ...}", "got 3")),
        ({"a": {"decay": 1}}, "callbacks.more.a", ("{callback: NAME, ...}", "{'decay': 1}")),
        ({"a": "os.system"}, "callbacks.more", ("'os.system'",)),
        ([], "callbacks.more", ("names",)),
    ],
)
def test_each_mistake_is_one_line(given: Any, about: str, named: tuple[str, ...]) -> None:
    with refused(OptionError, about, *named) as error:
        callback_entries(given)
    assert "\n" not in str(error.value)


def test_on_the_command_line_an_entry_is_a_name_and_its_options(tmp_path: Path) -> None:
    given = ("callbacks.more.stop=EarlyStopping", "callbacks.more.stop.monitor=val/abs_rell")
    answer = call("train.py", *TINY, *given, f"hydra.run.dir={tmp_path / 'run'}", cwd=tmp_path)
    assert answer.returncode == 2
    refused = refusal(answer.stderr)
    assert refused.about == "callbacks.more.stop.monitor"
    assert "'val/abs_rell'" in refused.message
    assert "'val/abs_rel'" in refused.message
    assert not (tmp_path / "run").exists()


def test_one_of_somebody_s_joins(tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from lightning import Callback

    seen: list[int] = []

    @register_callback("counter")
    class Counter(Callback):
        """Counts epochs."""

        def __init__(self, step: int = 1) -> None:
            self.step, self.count = step, 0

        def on_train_epoch_end(self, *given: Any) -> None:
            self.count += self.step
            seen.append(self.count)

        def state_dict(self) -> dict[str, Any]:
            return {"count": self.count}

        def load_state_dict(self, state_dict: dict[str, Any]) -> None:
            self.count = state_dict["count"]

    entry = ("++callbacks.more.mine.callback=counter", "++callbacks.more.mine.step=2")
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", 2, 0, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "run", SELDOM, *entry))
    train(options(tiny, tmp_path / "run", SELDOM, *entry))
    assert seen == [2, 4, 6]

"""A training that is killed or asked to stop ends in the weights and tables of one that was not."""

import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from cut_runs import SCORING, Compose, assert_the_same, options, status_of, stopped_in
from nursery import Nursery

from col3d.training.tasks import SupervisedTask
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

KILLS = 20


@pytest.fixture
def nursery(tmp_path: Path) -> Iterator[Nursery]:
    made = Nursery(tmp_path / "log.txt")
    yield made
    made.close()


def train_whole(nursery: Nursery, given: dict[str, Any]) -> float:
    start = time.monotonic()
    nursery.start(given)
    assert nursery.wait() == 0, nursery.log.read_text()
    return time.monotonic() - start


def test_killed_at_twenty_random_moments(tiny: Compose, nursery: Nursery, tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    train_whole(nursery, options(tiny, whole))  # renders the phantom, too
    seconds = train_whole(nursery, options(tiny, whole, "overwrite=true"))
    moments, kills, runs = random.Random(int(seconds * 1e6)), 0, 0
    while kills < KILLS:
        folder, runs = tmp_path / f"run_{runs}", runs + 1
        code = 1
        while code != 0:
            delay = moments.uniform(0, 0.7 * seconds)
            process = nursery.start(options(tiny, folder, f"data.workers={kills % 2}"))
            time.sleep(delay)
            with suppress(ProcessLookupError):  # it was faster
                os.kill(process, signal.SIGKILL)
            code = nursery.wait()
            assert code in (0, -signal.SIGKILL), nursery.log.read_text()
            kills += code != 0
        assert_the_same(folder, whole)


@pytest.mark.parametrize(
    ("where", "epoch", "batch", "signum", "code", "more"),
    [
        ("on_train_batch_start", 1, 0, signal.SIGTERM, 143, []),
        ("on_train_batch_start", 1, 1, signal.SIGHUP, 143, []),
        ("on_train_batch_start", 1, 1, signal.SIGTERM, 143, ["model=pix2pix"]),
        (
            "on_train_batch_start",
            0,
            2,
            signal.SIGUSR1,
            143,
            ["trainer.accumulate=2"],
        ),  # the last of the epoch
        ("on_train_batch_start", 1, 0, signal.SIGINT, 130, ["trainer.accumulate=2"]),
        ("validation_step", 1, 0, signal.SIGTERM, 143, ["data.batch_size=1"]),
        ("validation_step", 2, 1, signal.SIGTERM, 143, ["data.batch_size=1"]),
        (SCORING, 3, 0, signal.SIGTERM, 143, []),
    ],
)
def test_a_signal_saves_and_leaves(
    where: str,
    epoch: int,
    batch: int,
    signum: int,
    code: int,
    more: list[str],
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Not in the nursery: the step where it comes is chosen."""
    seldom = ["callbacks.checkpoint_minutes=60", *more]
    train(options(tiny, tmp_path / "whole", *seldom))
    with monkeypatch.context() as patched:
        stopped_in(patched, where, epoch, batch, signum)
        with pytest.raises(SystemExit) as left:
            train(options(tiny, tmp_path / "cut", *seldom))
    assert left.value.code == code
    assert "the same command goes on" in capsys.readouterr().out
    assert status_of(tmp_path / "cut")["state"] == "preempted"
    assert not (tmp_path / "cut" / "result.json").exists()
    train(options(tiny, tmp_path / "cut", *seldom))
    assert_the_same(tmp_path / "cut", tmp_path / "whole")
    assert status_of(tmp_path / "cut")["state"] == "done"
    assert status_of(tmp_path / "cut")["sessions"] == 2
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_second_signal_does_not_wait(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def twice(task: SupervisedTask, batch: Any, batch_idx: int) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError("it went on")

    monkeypatch.setattr(SupervisedTask, "training_step", twice)
    with pytest.raises(SystemExit) as left:
        train(options(tiny, tmp_path / "run"))
    assert left.value.code == 143
    assert status_of(tmp_path / "run")["state"] == "preempted"


def test_who_listened_before_is_told_after_all_is_saved(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As submitit, whose handler puts the job back into the queue."""
    heard: list[str] = []

    def requeue(signum: int, frame: Any) -> None:
        assert (tmp_path / "run" / "checkpoints" / "last.ckpt").is_file()
        heard.append(status_of(tmp_path / "run")["state"])

    before = signal.signal(signal.SIGUSR2, requeue)
    try:
        stopped_in(monkeypatch, "on_train_batch_start", 0, 0, signal.SIGUSR2)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "run"))
        assert heard == ["preempted"]
        assert signal.getsignal(signal.SIGUSR2) is requeue
    finally:
        signal.signal(signal.SIGUSR2, before)


def test_a_run_that_was_moved_goes_on(tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train(options(tiny, tmp_path / "whole"))
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", 2, 1, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "before"))
    (tmp_path / "before").rename(tmp_path / "after")
    train(options(tiny, tmp_path / "after"))
    assert_the_same(tmp_path / "after", tmp_path / "whole")


def test_an_epoch_of_some_of_its_batches_ends_where_it_ends(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next one begins at its own first batch, cut off between them or not."""

    class PowerCutError(Exception):
        pass

    def cut(task: SupervisedTask, batch: Any, batch_idx: int) -> None:
        if task.current_epoch == 1:
            raise PowerCutError

    some = ["callbacks.checkpoint_minutes=60", "trainer.limit_train_batches=2"]
    train(options(tiny, tmp_path / "whole", *some))
    with monkeypatch.context() as patched:
        patched.setattr(SupervisedTask, "on_train_batch_start", cut)
        with pytest.raises(PowerCutError):
            train(options(tiny, tmp_path / "cut", *some))
    assert status_of(tmp_path / "cut")["state"] == "failed"
    train(options(tiny, tmp_path / "cut", *some))
    assert_the_same(tmp_path / "cut", tmp_path / "whole")

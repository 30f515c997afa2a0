"""What goes wrong around a training is said in one line, and the same command then ends in the same weights.

Signals and kills are in test_resume.py, the files of checkpoints in test_checkpoint_files.py; the faults that
need a machine of their own (a full disk, a read-only one, a clock that jumps) in `tests.faults`.
"""

import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cut_runs import SCORING, assert_the_same, at, status_of, stopped_in
from refusals import refused
from tiny_run import TINY, composed

from col3d.errors import DataError, UserError
from col3d.runs.status import JobStatus
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

EPOCHS = 2
SMALL = (
    "model=bts",
    "model.encoder=lcnet_035",
    f"trainer.max_epochs={EPOCHS}",
    "callbacks.checkpoint_minutes=60",
)
FRAME = Path("cecum_t1_a") / "0001_color.png"
Damage = Callable[[Path], None]


def options(folder: Path, root: Path, *overrides: str) -> dict[str, Any]:
    return composed("train", *TINY, *SMALL, f"data.root={root}", f"output_dir={folder}", *overrides)


@pytest.fixture(scope="module")
def whole(phantom_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undisturbed run; the phantom is rendered after it."""
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    train(options(folder, phantom_root))
    return folder


@pytest.fixture(scope="module")
def stopped(whole: Path, phantom_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was asked to stop in its last epoch; to be copied."""
    folder = tmp_path_factory.mktemp("stopped") / "run"
    with pytest.MonkeyPatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", EPOCHS - 1, 1, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(folder, phantom_root))
    return folder


@pytest.fixture
def cut_off(stopped: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stopped, tmp_path / "run"))


def truncated(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def noise(path: Path) -> None:
    path.write_bytes(b"\xff\x00" * (path.stat().st_size // 2))


@pytest.mark.parametrize(("spoil", "said"), [(Path.unlink, "no such file"), (noise, "it is no image")])
def test_a_frame_that_is_lost_in_an_epoch(
    spoil: Damage, said: str, whole: Path, phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(shutil.copytree(phantom_root, tmp_path / "frames"))
    content = (root / FRAME).read_bytes()
    with monkeypatch.context() as patched:
        at(patched, "on_train_batch_start", 0, 2, lambda: spoil(root / FRAME))  # read next in epoch 2
        with refused(DataError, root / FRAME, said) as error:
            train(options(tmp_path / "run", root))
    line = str(error.value)

    status = status_of(tmp_path / "run")
    assert (status["state"], status["error"], status["epoch"]) == ("failed", line, 1)
    (root / FRAME).write_bytes(content)
    train(options(tmp_path / "run", root))
    assert_the_same(tmp_path / "run", whole)
    assert status_of(tmp_path / "run")["sessions"] == 2


def kill_workers() -> None:
    for process in multiprocessing.active_children():
        process.kill()


@pytest.mark.parametrize(
    ("hook", "epoch", "more"),
    [
        ("on_train_batch_start", 1, []),
        (SCORING, 2, ["data.batch_size=1"]),
    ],
)
def test_workers_that_are_killed(
    hook: str,
    epoch: int,
    more: list[str],
    whole: Path,
    phantom_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = options(tmp_path / "run", phantom_root, "data.workers=1", *more)
    with monkeypatch.context() as patched:
        at(patched, hook, epoch, 0, kill_workers)
        with refused(UserError, "data.workers", "same command") as error:
            train(given)
    assert len(str(error.value).splitlines()) == 1
    status = status_of(tmp_path / "run")
    assert (status["state"], status["error"]) == ("failed", str(error.value))
    train(given)
    assert status_of(tmp_path / "run")["state"] == "done"
    if not more:
        assert_the_same(tmp_path / "run", whole)


def test_a_damaged_last_checkpoint_gives_way_to_the_best(
    whole: Path, cut_off: Path, phantom_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flipped(cut_off / "checkpoints" / "last.ckpt")
    train(options(cut_off, phantom_root))
    said = capsys.readouterr().out
    assert said.count("note: damaged, and left aside: ") == 1
    assert f"goes on from {cut_off / 'checkpoints' / 'best.ckpt'}" in said
    assert_the_same(cut_off, whole)


@pytest.mark.parametrize("names", [("last", "best"), ("best",)])
def test_without_the_best_weights_it_starts_anew(
    names: tuple[str, ...], whole: Path, cut_off: Path, phantom_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in names:
        flipped(cut_off / "checkpoints" / f"{name}.ckpt")
    train(options(cut_off, phantom_root))
    said = capsys.readouterr().out
    assert said.count("note: ") == len(names)
    assert "goes on from" not in said
    assert f"epoch 1/{EPOCHS}" in said
    assert_the_same(cut_off, whole)


@pytest.mark.parametrize("damage", [truncated, noise])
def test_damaged_tables_do_no_harm(damage: Damage, whole: Path, cut_off: Path, phantom_root: Path) -> None:
    for name in ("status.json", "metrics.csv", "config.yaml"):
        damage(cut_off / name)
    train(options(cut_off, phantom_root))
    assert_the_same(cut_off, whole)
    assert status_of(cut_off)["state"] == "done"


@pytest.mark.parametrize("name", ["result.json", "summary.json"])
def test_a_damaged_end_does_no_harm(name: str, whole: Path, phantom_root: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole, tmp_path / "run"))
    truncated(run / name)
    train(options(run, phantom_root))
    assert_the_same(run, whole)


def test_without_a_key_wandb_goes_on_offline(
    phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("WANDB_API_KEY", "WANDB_MODE", "WANDB_IDENTITY_TOKEN_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("NETRC", str(tmp_path / "none"))
    monkeypatch.setenv("WANDB_BASE_URL", "http://127.0.0.1:9")
    online = ("logger=wandb", "logger.wandb.offline=false", "trainer.max_epochs=1")
    train(options(tmp_path / "run", phantom_root, *online))
    assert "note: W&B goes on offline: there is no key" in capsys.readouterr().out
    assert len(list((tmp_path / "run" / "wandb").glob("offline-run-*/*.wandb"))) == 1
    assert status_of(tmp_path / "run")["state"] == "done"


def test_a_setting_that_wandb_does_not_know_is_refused(
    phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WANDB_MODE", "sometimes")
    with refused(UserError, "WANDB_MODE of the environment", "online", "'sometimes'"):
        train(options(tmp_path / "run", phantom_root, "logger=wandb"))


def test_counts_of_an_earlier_session_that_are_none_begin_anew(tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text('{"seconds": null, "sessions": "many"}')
    status = JobStatus(tmp_path)
    assert status.seconds_before == 0
    assert status.content["sessions"] == 1

"""Loggers by name, one or several, beside metrics.csv."""

import signal
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

import lightning.pytorch.loggers as lightnings
import pytest
from cut_runs import assert_the_same, options, stopped_in
from programs import call
from refusals import refusal, refused
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny_run import TINY, composed

from col3d.errors import OptionError, UserError
from col3d.registry import LOGGERS, available, register_logger
from col3d.registry.earlier import updated
from col3d.registry.refusals import check_options
from col3d.runs.logger_options import check_installed, logger_entries
from col3d.training.options import TrainOptions
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
CLASSES = {
    "wandb": "WandbLogger",
    "tensorboard": "TensorBoardLogger",
    "mlflow": "MLFlowLogger",
    "comet": "CometLogger",
    "litlogger": "LitLogger",
}


def events(run: Path) -> EventAccumulator:
    [folder] = (run / "tensorboard").iterdir()
    found = EventAccumulator(str(folder))
    found.Reload()
    return found


def test_tensorboard_and_wandb_log_what_metrics_csv_has(tiny: Compose, tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(options(tiny, run, "logger=[wandb,tensorboard]", "callbacks.panels=1", "trainer.max_epochs=2"))
    found = events(run)
    scalars = found.Tags()["scalars"]
    assert {"train/loss", "val/abs_rel", "val/angle_mean", "test/abs_rel"} <= {*scalars}
    lines = (run / "metrics.csv").read_text().splitlines()
    place = lines[0].split(",").index("val/abs_rel")
    written = [float(line.split(",")[place]) for line in lines[1:] if line.split(",")[place]]
    assert [event.value for event in found.Scalars("val/abs_rel")] == pytest.approx(written, rel=1e-6)
    assert [tag for tag in found.Tags()["images"] if tag.startswith("panels/")]
    assert len(list((run / "wandb").glob("offline-run-*/*.wandb"))) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_a_run_that_goes_on_writes_the_same_log(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ("logger=tensorboard", "callbacks.checkpoint_minutes=60")
    train(options(tiny, tmp_path / "whole"))
    with monkeypatch.context() as patched:
        stopped_in(patched, "on_train_batch_start", 2, 0, signal.SIGTERM)
        with pytest.raises(SystemExit):
            train(options(tiny, tmp_path / "run", *given))
    train(options(tiny, tmp_path / "run", *given))
    assert_the_same(tmp_path / "run", tmp_path / "whole")
    assert len(events(tmp_path / "run").Scalars("val/abs_rel")) == 3


@pytest.mark.parametrize(
    "name", [name for name in available("logger") if name not in ("wandb", "tensorboard")]
)
def test_one_whose_package_is_missing_says_which(name: str, tiny: Compose, tmp_path: Path) -> None:

    with refused(UserError, "logger", name, f"pip install '{LOGGERS[name].facts['install']}'"):
        train(options(tiny, tmp_path / "run", f"logger={name}"))
    assert not (tmp_path / "run").exists()


def test_extras_are_those_of_the_project() -> None:
    import tomllib

    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    for name in available("logger"):
        install = LOGGERS[name].facts["install"]
        if install.startswith("col3d["):
            assert install[6:-1] in project["optional-dependencies"], name


@pytest.mark.parametrize("name", CLASSES)
def test_options_are_those_of_lightning(name: str) -> None:
    theirs = signature(getattr(lightnings, CLASSES[name])).parameters
    assert {*LOGGERS[name].parameters()} <= {*theirs}
    assert {*available("logger")} == {*CLASSES}
    assert {*CLASSES.values(), "CSVLogger", "Logger"} == {*lightnings.__all__}


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        ({"tensorbord": {}}, "logger", ("'tensorbord'", "'tensorboard'")),
        (
            {"tensorboard": {"prefx": "a"}},
            "logger.tensorboard.prefx",
            ("no such option", "'logger.tensorboard.prefix'"),
        ),
        ({"wandb": {"offline": "perhaps"}}, "logger.wandb.offline", ("boolean", "'perhaps'")),
        ({"wandb": {"project": "a/b"}}, "logger.wandb.project", ("without", "'a/b'")),
        ({"wandb": 3}, "logger.wandb", ("options", 3)),
        ("wandb", "logger", ("logger=NAME or logger=[NAME,NAME]", "'wandb'")),
        ({"os.system": {}}, "logger", ("'os.system'",)),
    ],
)
def test_each_mistake_is_one_line(given: Any, about: str, named: tuple[object, ...]) -> None:
    with refused(OptionError, about, *named) as error:
        logger_entries(given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        (["logger=tensorbord"], "logger", "'tensorboard'"),
        (["logger=[wandb,mlflow]"], "logger", "mlflow needs "),
        (["logger=wandb", "logger.project=a/b"], "logger.wandb.project", "a/b"),
    ],
)
def test_on_the_command_line(given: list[str], about: str, named: str, tmp_path: Path) -> None:
    answer = call("train.py", *TINY, *given, f"hydra.run.dir={tmp_path / 'run'}", cwd=tmp_path)
    assert answer.returncode == 2
    assert refusal(answer.stderr).about == about
    assert named in answer.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("before", "now"),
    [
        ({"name": "csv", "project": "col3d", "offline": True}, {}),
        (
            {"name": "wandb", "project": "p", "offline": False},
            {"wandb": {"project": "p", "offline": False, "prefix": None, "log_model": False}},
        ),
    ],
)
def test_options_of_before_are_read(before: dict[str, Any], now: dict[str, Any]) -> None:
    given = {**composed("train", "output_dir=x"), "logger": before}
    assert check_options(TrainOptions, updated(given)).model_dump(mode="json")["logger"] == now


def test_one_of_somebody_s(tiny: Compose, tmp_path: Path) -> None:
    seen: list[tuple[str, Any]] = []

    class Mine(lightnings.Logger):
        """Remembers."""

        def __init__(self, folder: Path, run: str, level: int = 1) -> None:
            super().__init__()
            seen.append(("made", (folder.name, len(run), level)))

        @property
        def name(self) -> str:
            return "mine"

        @property
        def version(self) -> str:
            return ""

        def log_hyperparams(self, params: Any, *given: Any, **more: Any) -> None:
            seen.append(("options", params["optimizer.name"]))

        def log_metrics(self, metrics: Any, step: int | None = None) -> None:
            seen.append(("metrics", set(metrics)))

        def finalize(self, status: str) -> None:
            seen.append(("end", status))

    register_logger("mine", Mine, needs=("nowhere",), install="nowhere-at-all")
    with refused(UserError, "logger", "pip install 'nowhere-at-all'"):
        check_installed({"mine": LOGGERS["mine"].options()()})
    LOGGERS.parts.pop("mine")
    register_logger("mine", Mine)
    train(options(tiny, tmp_path / "run", "+logger.mine.level=3", "trainer.max_epochs=1"))
    assert seen[:2] == [("made", ("run", 16, 3)), ("options", "adamw")]
    assert any("test/abs_rel" in said for kind, said in seen if kind == "metrics")
    assert seen[-1] == ("end", "success")

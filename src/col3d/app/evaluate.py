"""Score a checkpoint of a training on a part of a split."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from col3d.app import build
from col3d.app.config import EvaluateOptions, TrainOptions
from col3d.app.errors import check_options
from col3d.app.results import Results
from col3d.app.train import check_accelerator, make_trainer, quiet
from col3d.checks import UserError


def evaluate(given: Mapping[str, Any]) -> None:
    """Rebuild network and data from the checkpoint's own options and write the tables of one part.

    Args:
        given: the composed configuration as plain values; see `EvaluateOptions`.

    Raises:
        UserError: an option, the checkpoint or the data breaks a rule.
    """
    quiet()
    options = check_options(EvaluateOptions, given)
    check_accelerator(options.accelerator)
    path = Path(options.checkpoint)
    trained = _as_asked(trained_options(path), options)
    folder = Path(options.output_dir) if options.output_dir else _beside(path, options.split)
    task = build.task(trained)
    build.load_weights(task, path)
    data = build.data_module(trained.data, trained.phantom, trained.seed, [options.split])
    lengths = data.lengths()
    data.frames["test"] = data.frames[options.split]
    folder.mkdir(parents=True, exist_ok=True)
    results = Results(trained, folder, options.split, lengths, options.panels)
    trainer = make_trainer(trained, results.callbacks, [])
    trainer.test(task, datamodule=data, verbose=False)
    results.write(task, path, {})


def trained_options(path: Path) -> TrainOptions:
    """The options that a checkpoint was trained with.

    Raises:
        UserError: the file is missing, or no checkpoint of `train.py`.
    """
    if not path.is_file():
        raise UserError(f"checkpoint: no such file: {path}")
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
        given = dict(checkpoint["hyper_parameters"]["options"])
    except Exception:  # a file that is none of ours may fail in any way while it is read
        raise UserError(f"checkpoint: {path} is not a checkpoint written by train.py") from None
    try:
        return check_options(TrainOptions, given)
    except UserError as error:
        raise UserError(f"checkpoint: {path} was trained with options of another version: {error}") from None


def _as_asked(trained: TrainOptions, options: EvaluateOptions) -> TrainOptions:
    """The training's options with what the evaluation changes: one device, and no weights to fetch."""
    asked = {name: getattr(options, name) for name in ("root", "batch_size", "workers")}
    machine = {"accelerator": options.accelerator, "devices": 1, "strategy": "auto"}
    changes = {
        "data": trained.data.model_copy(update={k: v for k, v in asked.items() if v is not None}),
        "model": trained.model.model_copy(update={"pretrained": None}),
        "trainer": trained.trainer.model_copy(update=machine),
    }
    return trained.model_copy(update=changes)


def _beside(checkpoint: Path, split: str) -> Path:
    """A folder of the run that the checkpoint belongs to."""
    run = checkpoint.parent.parent if checkpoint.parent.name == "checkpoints" else checkpoint.parent
    return run / f"evaluation_{split}"

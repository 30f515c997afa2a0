"""Score a checkpoint of a training on a part of a split."""

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from col3d.app import build
from col3d.app.config import EvaluateOptions, TrainOptions
from col3d.app.errors import check_options
from col3d.app.results import Results
from col3d.app.train import make_trainer
from col3d.checks import UserError
from col3d.data.datamodule import FrameDataModule


def evaluate(given: Mapping[str, Any]) -> None:
    """Rebuild network and data from the checkpoint's own options and write the tables of one part.

    Args:
        given: the composed configuration as plain values; see `EvaluateOptions`.

    Raises:
        UserError: an option, the checkpoint or the data breaks a rule.
    """
    options = check_options(EvaluateOptions, given)
    path = Path(options.checkpoint)
    trained = trained_options(path)
    changed = {name: getattr(options, name) for name in ("root", "batch_size", "workers")}
    data_options = trained.data.model_copy(update={k: v for k, v in changed.items() if v is not None})
    model_options = trained.model.model_copy(update={"pretrained": None})
    trained = trained.model_copy(
        update={
            "data": data_options,
            "model": model_options,
            "trainer": trained.trainer.model_copy(
                update={
                    "accelerator": options.accelerator,
                    "devices": 1,
                    "strategy": "auto",
                    "overfit_batches": 0,
                }
            ),
        }
    )
    folder = Path(options.output_dir) if options.output_dir else _beside(path, options.split)
    task = build.task(trained)
    build.load_weights(task, path)
    whole = build.data_module(data_options, trained.phantom, trained.seed, [options.split])
    frames = whole.frames[options.split]
    data = FrameDataModule({"test": frames}, data_options.batch_size, data_options.workers)
    folder.mkdir(parents=True, exist_ok=True)
    results = Results(trained, folder, options.split, {options.split: len(frames)}, options.panels)  # type: ignore[arg-type]
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
        given = checkpoint["hyper_parameters"]["options"]
    except (KeyError, TypeError, RuntimeError, pickle.UnpicklingError, EOFError):
        raise UserError(f"checkpoint: {path} is not a checkpoint written by train.py") from None
    return check_options(TrainOptions, given)


def _beside(checkpoint: Path, split: str) -> Path:
    """A folder of the run that the checkpoint belongs to."""
    run = checkpoint.parent.parent if checkpoint.parent.name == "checkpoints" else checkpoint.parent
    return run / f"evaluation_{split}"

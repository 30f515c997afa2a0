"""Train a network, evaluate its best checkpoint on the test split, and write everything into one folder."""

import logging
import math
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, Trainer, seed_everything
from lightning.pytorch.callbacks import LearningRateMonitor, ModelCheckpoint, RichProgressBar
from lightning.pytorch.loggers import Logger

from col3d.app import build
from col3d.app.config import TrainerOptions, TrainOptions
from col3d.app.cost import measure_cost
from col3d.app.errors import check_options
from col3d.app.frames import data_module, settled
from col3d.app.results import Results, facts_of
from col3d.app.run_folder import RunFolder
from col3d.app.scored import Scored
from col3d.app.tracking import csv_logger, wandb_run
from col3d.callbacks import EpochLines, FiniteCheckpoint, FiniteNumbers, SavePredictions
from col3d.callbacks.finite_numbers import DivergedError
from col3d.checks import UserError
from col3d.data.datamodule import FrameDataModule
from col3d.reports.summary import print_summary
from col3d.tasks import SupervisedTask

WATCHED = "val/abs_rel"
INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def train(given: Mapping[str, Any]) -> float:
    """Run the whole job that the options describe.

    A folder that holds the finished run of the same options is left as it is, and its table shown again; one
    that was cut off goes on from its last epoch.

    Args:
        given: the composed configuration as plain values; see `TrainOptions`.

    Returns:
        The best abs_rel on the validation split.

    Raises:
        UserError: an option or the data breaks a rule, in one line for each.
    """
    quiet()
    options = check_options(TrainOptions, given)
    check_accelerator(options.trainer.accelerator)
    data = settled(options.data, options.phantom)
    options = options.model_copy(update={"data": data})
    folder = RunFolder(options)
    if folder.finished is not None:
        print_summary(folder.finished)
        print(f"finished before: {folder.path}; overwrite=true trains again")
        return float(folder.finished["best"][WATCHED])
    seed_everything(options.seed, workers=True, verbose=False)
    truth = options.one_protocol[1].truth
    frames = data_module(options.data, options.phantom, options.seed, test_truth=truth)
    task = build.task(options)
    Scored.after(options.data, "test").print_audit()
    folder.begin()
    with wandb_run(options, folder.path) as loggers:
        loggers.append(csv_logger(folder.path, folder.epoch))
        return _fit_and_test(options, folder, frames, task, loggers)


def _fit_and_test(
    options: TrainOptions,
    folder: RunFolder,
    data: FrameDataModule,
    task: SupervisedTask,
    loggers: list[Logger],
) -> float:
    best = FiniteCheckpoint(
        folder.path / "checkpoints",
        filename="best",
        monitor=WATCHED,
        enable_version_counter=False,
    )
    # Not save_last=True, which skips the epochs that are not the best so far.
    last = ModelCheckpoint(folder.path / "checkpoints", filename="last", enable_version_counter=False)
    name, protocol = options.one_protocol
    scored = Scored.after(options.data, "test")
    facts = facts_of(options.model.name, options.seed, scored, name)
    results = Results(
        facts,
        folder.path,
        scored,
        data.lengths(),
        options.callbacks.panels,
        protocol.average,
    )
    kept = _kept_predictions(options, folder.path)
    adversarial = options.task.name == "adversarial"
    callbacks = [best, last, *_watchers(folder.path), *results.callbacks, *kept]
    trainer = make_trainer(options.trainer, callbacks, loggers, adversarial=adversarial)
    try:
        trainer.fit(task, datamodule=data, ckpt_path=folder.cut_off, weights_only=True)
    except DivergedError as error:
        raise UserError(str(error)) from None
    except (KeyboardInterrupt, SystemExit):
        print("stopped; the same command goes on from the last epoch", flush=True)
        raise SystemExit(INTERRUPTED) from None
    if best.best_model_score is None or not math.isfinite(best.best_model_score):
        raise UserError(f"{WATCHED} was never finite: nothing to evaluate; lower optimizer.lr")
    epoch = build.load_weights(task, Path(best.best_model_path))
    trainer.test(task, datamodule=data, verbose=False)
    score = float(best.best_model_score)
    if trainer.is_global_zero:
        height, width = options.data.size
        cost = measure_cost(task.network, (height, width))
        results.write(task, Path(best.best_model_path), {WATCHED: score, "epoch": epoch}, loggers, cost)
    return score


def _kept_predictions(options: TrainOptions, folder: Path) -> list[Callback]:
    if not options.callbacks.predictions:
        return []
    facts = {"max_depth": options.model.max_depth, "split": "test"}
    return [SavePredictions(folder / "predictions_test", facts)]


def quiet() -> None:
    """Silence what Lightning says of every run, advertisements included, and one of its own deprecations."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    logging.getLogger("lightning.fabric").setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=r".*isinstance\(treespec, LeafSpec\)")
    warnings.filterwarnings("ignore", message=".*directory .* exists and is not empty")
    warnings.filterwarnings("ignore", message=".*does not have many workers which may be a bottleneck")


def check_accelerator(name: str) -> None:
    """Refuse an accelerator that this machine does not have.

    Raises:
        UserError: names the option.
    """
    if name in ("gpu", "cuda") and not torch.cuda.is_available():
        raise UserError(f"trainer.accelerator: this machine has no {name}; take auto or cpu")


def make_trainer(
    given: TrainerOptions, callbacks: list[Callback], loggers: list[Logger], adversarial: bool = False
) -> Trainer:
    """Lightning's Trainer; samplers are ours, so that evaluation counts each frame once under DDP."""
    # Each of two networks that learn in turn leaves the other's gradients out.
    parts_unused = adversarial and (given.strategy == "ddp" or given.devices != 1)
    strategy = "ddp_find_unused_parameters_true" if parts_unused else given.strategy
    on_cpu = given.accelerator == "cpu" or not torch.cuda.is_available()  # metrics are float64: no MPS
    return Trainer(
        max_epochs=given.max_epochs,
        accelerator="cpu" if on_cpu else "cuda",
        devices=given.devices,
        strategy=strategy,
        precision=given.precision,
        gradient_clip_val=None if adversarial else given.gradient_clip,  # that task clips by itself
        accumulate_grad_batches=given.accumulate,
        deterministic=given.deterministic,
        limit_train_batches=given.limit_train_batches,
        callbacks=callbacks,
        logger=loggers or False,
        use_distributed_sampler=False,
        log_every_n_steps=1,
        num_sanity_val_steps=0,
        enable_model_summary=False,
        enable_progress_bar=sys.stdout.isatty(),
        enable_checkpointing=any(isinstance(callback, ModelCheckpoint) for callback in callbacks),
    )


def _watchers(folder: Path) -> list[Callback]:
    bar: list[Callback] = [RichProgressBar()] if sys.stdout.isatty() else []
    return [FiniteNumbers(folder), LearningRateMonitor(logging_interval="epoch"), EpochLines(), *bar]

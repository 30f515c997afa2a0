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
from lightning.fabric.plugins.environments import SLURMEnvironment
from lightning.pytorch.callbacks import Checkpoint, RichProgressBar
from lightning.pytorch.loggers import Logger

from col3d.app import build
from col3d.app.checkpoints import CheckpointFiles
from col3d.app.compiled import compile_network
from col3d.app.config import TrainerOptions, TrainOptions
from col3d.app.cost import measure_cost
from col3d.app.errors import check_options
from col3d.app.foreseen import in_a_line
from col3d.app.frames import data_module, settled
from col3d.app.job import JobStatus, locked, reported
from col3d.app.metrics_file import MetricsFile, RowsInCheckpoints
from col3d.app.provenance import provenance
from col3d.app.rank import end_with_first, is_first
from col3d.app.results import Results, facts_of
from col3d.app.run_folder import CHECKPOINTS, RunFolder
from col3d.app.scored import Scored
from col3d.app.tracking import wandb_run
from col3d.callbacks import (
    About,
    BestCheckpoint,
    EpochLines,
    FiniteNumbers,
    LastCheckpoint,
    SavePredictions,
    Stopped,
    StopSignals,
)
from col3d.checks import UserError
from col3d.data.datamodule import FrameDataModule
from col3d.reports.jobs import RESULT, read_plain
from col3d.reports.summary import print_summary
from col3d.tasks import SupervisedTask

WATCHED = "val/abs_rel"


def train(given: Mapping[str, Any]) -> float | tuple[float, ...]:
    """Run the whole job that the options describe.

    A folder that holds the finished run of the same options is left as it is, and its table shown again; one
    that was cut off goes on from its last checkpoint. Signals that ask it to stop make it save and leave.

    Args:
        given: the composed configuration as plain values; see `TrainOptions`.

    Returns:
        What `objective` names, of the best epoch: lower is better.

    Raises:
        UserError: an option or the data breaks a rule, in one line for each.
        TakenError: another process trains in that folder.
        Stopped: it was asked to stop; its exit code says how.
    """
    quiet()
    options = check_options(TrainOptions, given)
    check_accelerator(options.trainer.accelerator)
    data = settled(options.data, options.phantom)
    options = options.model_copy(update={"data": data})
    path = Path(options.output_dir)
    end_with_first()
    with StopSignals() as stop:
        try:
            with locked(path):
                return _trained(options, RunFolder(options), stop)
        except Stopped as stopped:
            if is_first():
                print(f"stopped; the same command goes on: {path}", flush=True)
                stop.hand_on(stopped.signum)
            raise SystemExit(stopped.code if is_first() else 0) from None
        finally:
            if torch.distributed.is_initialized():  # the next job of a sweep has other processes beside it
                torch.distributed.destroy_process_group()


def _trained(options: TrainOptions, folder: RunFolder, stop: StopSignals) -> float | tuple[float, ...]:
    """What comes of a run, now or before."""
    if not folder.finished:
        with reported(JobStatus(folder.path)) as status:
            _run(options, folder, stop, status)
    else:
        if summary := read_plain(folder.path / "summary.json"):
            print_summary(summary)
        print(f"finished before: {folder.path}; overwrite=true trains again")
    if not is_first():
        return math.nan
    best = read_plain(folder.path / RESULT)["best"]
    score = tuple(float(best[name]) for name in options.objective)
    return score[0] if len(score) == 1 else score


def _run(options: TrainOptions, folder: RunFolder, stop: StopSignals, status: JobStatus) -> None:
    seed_everything(options.seed, workers=True, verbose=False)
    truth = options.one_protocol[1].truth
    frames = data_module(options.data, options.phantom, options.seed, test_truth=truth)
    task = build.task(options)
    if options.trainer.compile:
        compile_network(task.network)
    scored = Scored.after(options.data, "test")
    if is_first():
        scored.print_audit()
        folder.begin()
    status.write("running")
    with wandb_run(options, folder.path) as loggers:
        table = MetricsFile(folder.path / "metrics.csv", folder.rows)
        loggers.append(table)
        _fit_and_test(options, folder, frames, task, scored, loggers, RowsInCheckpoints(table), stop, status)


def _fit_and_test(
    options: TrainOptions,
    folder: RunFolder,
    data: FrameDataModule,
    task: SupervisedTask,
    scored: Scored,
    loggers: list[Logger],
    rows: Callback,
    stop: StopSignals,
    status: JobStatus,
) -> None:
    place = folder.path / CHECKPOINTS
    best = BestCheckpoint(place / "best.ckpt", WATCHED)
    last = LastCheckpoint(place / "last.ckpt", options.callbacks.checkpoint_minutes, stop)
    name, protocol = options.one_protocol
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
    watchers = _watchers(folder.path, options.trainer.max_epochs, status)
    about = About({**provenance(), **data.about(), "split": options.data.split.model_dump()})
    trainer = make_trainer(
        options.trainer,
        [about, rows, best, last, *watchers, *results.callbacks, *kept],
        loggers,
        adversarial=options.task.name == "adversarial",
    )
    with in_a_line(_smaller(options)):
        trainer.fit(task, datamodule=data, ckpt_path=folder.cut_off, weights_only=True)
    if best.best_model_score is None:
        raise UserError(f"{WATCHED} was never finite: nothing to evaluate; lower optimizer.lr")
    epoch = build.load_weights(task, best.path)
    with in_a_line(_smaller(options)):
        trainer.test(task, datamodule=data, verbose=False)
    if trainer.is_global_zero:
        height, width = options.data.size
        cost = measure_cost(task.network, (height, width))
        found = {**best.metrics, "epoch": epoch}
        summary = results.write(task, best.path, found, loggers, cost)
        folder.finish(found, summary["metrics"], status.seconds)


def _smaller(options: TrainOptions) -> str:
    """What to change where memory is out: the same steps from half as much at a time."""
    size, accumulate = options.data.batch_size, options.trainer.accumulate
    if size > 1:
        halved = f"data.batch_size={size // 2} trainer.accumulate={accumulate * 2}"
        return f"data.batch_size={size} is too much; {halved} takes half of it a step and is trained alike"
    height, width = options.data.size
    return f"data.size=[{height // 2},{width // 2}] takes a quarter; so does a smaller model.encoder"


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
    warnings.filterwarnings("ignore", message="The `srun` command is available on your system but is not")


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
        plugins=_plugins(),
        use_distributed_sampler=False,
        log_every_n_steps=1,
        num_sanity_val_steps=0,
        enable_model_summary=False,
        enable_progress_bar=sys.stdout.isatty(),
        enable_checkpointing=any(isinstance(callback, Checkpoint) for callback in callbacks),
    )


def _watchers(folder: Path, epochs: int, status: JobStatus) -> list[Callback]:
    bar: list[Callback] = [RichProgressBar()] if sys.stdout.isatty() else []

    def epoch_done(epoch: int) -> None:
        status.write("running", epoch=epoch, epochs=epochs)

    return [FiniteNumbers(folder), EpochLines(epoch_done), *bar]


def _plugins() -> list[Any]:
    """Checkpoints that are whole or not there; on a cluster, no requeueing by Lightning."""
    cluster = [SLURMEnvironment(auto_requeue=False)] if SLURMEnvironment.detect() else []
    return [CheckpointFiles(), *cluster]

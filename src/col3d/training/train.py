"""Train a network, evaluate its best checkpoint on the test split, and write everything into one folder."""

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, seed_everything
from lightning.pytorch.callbacks import RichProgressBar
from lightning.pytorch.loggers import Logger

from col3d.data.build import data_module, resolve_source_paths
from col3d.data.checks.truth import check_truth
from col3d.data.datamodule import FrameDataModule
from col3d.errors import UserError
from col3d.evaluation.results import Results, facts_of
from col3d.evaluation.scored_part import Scored
from col3d.inference.compiled import compile_network
from col3d.io.atomic import write_whole
from col3d.layers.network import parameters_of
from col3d.losses import WeightedLoss
from col3d.metrics.measure import try_metrics
from col3d.registry.refusals import check_options
from col3d.runs.checkpoint_callbacks import About, BestCheckpoint, LastCheckpoint
from col3d.runs.environment import check_accelerator, device_for, quiet
from col3d.runs.folder import CHECKPOINTS, KIND, RunFolder
from col3d.runs.known_failures import as_user_errors
from col3d.runs.lock import locked
from col3d.runs.logger_options import check_installed
from col3d.runs.metrics_file import MetricsFile, RowsInCheckpoints
from col3d.runs.open_loggers import loggers_of
from col3d.runs.provenance import provenance
from col3d.runs.rank import exit_with_rank_zero, is_first
from col3d.runs.starts import this_start
from col3d.runs.status import JobStatus, reported
from col3d.signals import Stopped, StopSignals
from col3d.training.build import build_task
from col3d.training.callback_options import callbacks_of
from col3d.training.callbacks.epoch_lines import EpochLines
from col3d.training.callbacks.finite_numbers import FiniteNumbers
from col3d.training.callbacks.named import StoppedEarly, unheard
from col3d.training.callbacks.same_batches import SameBatches
from col3d.training.callbacks.unfreeze import Unfreeze
from col3d.training.decorate import decorate, show_again
from col3d.training.final_test import best_network, score_best
from col3d.training.initial_weights import begin_from
from col3d.training.memory_advice import memory_advice
from col3d.training.options import TrainOptions
from col3d.training.run_request import run_request, weight_files
from col3d.training.tasks import SupervisedTask
from col3d.training.trainer import make_trainer
from col3d.training.trial import trial

WATCHED = "val/abs_rel"


def train(given: Mapping[str, Any]) -> float | tuple[float, ...]:
    """Train a network as the options say, and test its best epoch.

    If the folder holds the finished run of the same options, it is left unchanged and its table is printed
    again; an interrupted run goes on from its last checkpoint. On a stop signal the training saves and exits.

    Args:
        given: the composed configuration as plain values; see `TrainOptions`.

    Returns:
        The metrics that `objective` names, of the best epoch: lower is better.

    Raises:
        UserError: an option or the data breaks a rule, in one line for each.
        RunLockedError: another process trains in that folder.
        SystemExit: a signal stopped it; 130 after Ctrl-C, 143 after the others.
    """
    quiet()
    options = check_options(TrainOptions, given)
    check_accelerator(options.trainer.accelerator)
    if options.trainer.cudagraphs and device_for(options.trainer.accelerator).type != "cuda":
        raise UserError("trainer.cudagraphs: needs a GPU, and this training has none; leave it false")
    check_installed(options.logger)
    if options.trainer.fast_dev_run:
        with trial(options) as options_of_trial:
            return _at_work(options_of_trial)
    return _at_work(options)


def _at_work(options: TrainOptions) -> float | tuple[float, ...]:
    """Lock the run's folder, train in it, and return the objective."""
    data = resolve_source_paths(options.data, options.phantom)
    options = options.model_copy(update={"data": data})
    path = Path(options.output_dir)
    exit_with_rank_zero()
    with StopSignals() as stop:
        try:
            with locked(path):
                return _trained(options, RunFolder(run_request(options)), stop)
        except Stopped as stopped:
            if is_first():
                print(f"\nstopped; the same command goes on: {path}", flush=True)
                stop.hand_on(stopped.signum)
            raise SystemExit(stopped.code if is_first() else 0) from None
        finally:
            if torch.distributed.is_initialized():  # the next job of a sweep starts other processes
                torch.distributed.destroy_process_group()


def _trained(options: TrainOptions, folder: RunFolder, stop: StopSignals) -> float | tuple[float, ...]:
    """Train unless the run is finished, and return the objective of its best epoch."""
    if not folder.finished:
        with reported(JobStatus(folder.path)) as status:
            _run(options, folder, stop, status)
    elif is_first():
        show_again(options, folder)
    if not is_first():
        return math.nan
    best = folder.finished["best"]
    score = tuple(math.nan if best.get(name) is None else float(best[name]) for name in options.objective)
    return score[0] if len(score) == 1 else score


def _run(options: TrainOptions, folder: RunFolder, stop: StopSignals, status: JobStatus) -> None:
    seed_everything(options.seed, workers=True, verbose=False)
    frames = data_module(options.data, options.phantom, options.seed)
    task = build_task(options)
    try_metrics(tuple(task.val_metrics), (options.data.size[0], options.data.size[1]), options.metrics)
    say = print if is_first() else lambda line: None
    assert isinstance(task.loss, WeightedLoss)
    say(f"minimises {task.loss.formula}")
    if folder.cut_off is None:
        begin_from(task.network, options.init, say)
    if options.trainer.compile:
        compile_network(task.network, cudagraphs=options.trainer.cudagraphs)
    learns_normals = bool(options.loss.learning_from("normals"))
    check_truth(frames.frames, options.data, options.one_protocol[1].truth_range, learns_normals, say)
    scored = Scored.after(options.data, "test")
    if is_first():
        scored.print_audit()
        folder.begin(this_start(options.data, options.phantom, weight_files(options)))
    status.write("running")
    goes_on = folder.cut_off is not None
    config = options.model_dump(mode="json")
    with loggers_of(options.logger, config, folder.path, folder.starts.run, goes_on) as loggers:
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
        KIND,
        scored,
        data.lengths(),
        options.callbacks.panels,
        protocol,
        folder.starts.changes(),
    )
    watchers = _watchers(folder.path, options.trainer.max_epochs, status)
    split = options.data.split.model_dump()
    about = About({"run": folder.starts.run, **provenance(), **data.about(), "split": split})
    trainer = make_trainer(
        options.trainer,
        [
            *joining(options, task),
            about,
            rows,
            best,
            last,
            *watchers,
        ],
        loggers,
        adversarial=options.task.name == "adversarial",
        folder=folder.path,
    )
    with as_user_errors(memory_advice(options)):
        trainer.fit(task, datamodule=data, ckpt_path=folder.cut_off, weights_only=True)
    if best.best_model_score is None:
        raise UserError(f"{WATCHED} was never finite: nothing to evaluate; lower optimizer.lr")
    if is_first() and not last.path.is_file():  # only the best checkpoint was left, of the last epoch
        write_whole(last.path, best.path.read_bytes())
    trained = best_network(folder)
    with as_user_errors(memory_advice(options)):
        keep = options.callbacks.predictions
        score_best(options, folder, trained, data, results, trainer.strategy.root_device, keep)
    summary = {}
    if is_first():
        if options.trainer.limit_test_batches is not None:
            print("note: tested on some batches of the test split alone", flush=True)
        scores = {**best.metrics, "epoch": int(trained.content["epoch"])}
        results.table.save()
        tables = [logger for logger in loggers if isinstance(logger, MetricsFile)]
        summary = results.write(best.path, parameters_of(trained.network), scores, tables)
        folder.finish(scores, summary["metrics"], status.seconds)
    others = [logger for logger in loggers if not isinstance(logger, MetricsFile)]
    shown = decorate(folder, results, summary, trained, others)
    if is_first():
        results.show(shown, best.path)


def joining(options: TrainOptions, task: SupervisedTask) -> list[Callback]:
    """Build the callbacks that the options name or imply; they come before those that save."""
    named: list[Callback] = callbacks_of(options.callbacks.more)
    for note in unheard(named) if is_first() else ():
        print(note, flush=True)
    implied: list[Callback] = [] if options.trainer.overfit_batches is None else [SameBatches()]
    if options.model.unfreeze_at is not None:
        implied.append(Unfreeze(task.network.get_submodule("encoder"), options.model.unfreeze_at))
    return [*implied, *named, *([StoppedEarly()] if named else [])]


def _watchers(folder: Path, epochs: int, status: JobStatus) -> list[Callback]:
    bar: list[Callback] = [RichProgressBar()] if sys.stdout.isatty() else []

    def epoch_done(epoch: int) -> None:
        status.write("running", epoch=epoch, epochs=epochs)

    return [FiniteNumbers(folder), EpochLines(epoch_done), *bar]

"""Score a checkpoint, of a training or of the authors' programs, on a part of a split."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.app import build
from col3d.app.config import DataOptions, EvaluateOptions, PhantomOptions, TrainerOptions, TrainOptions
from col3d.app.errors import check_options
from col3d.app.results import Results, facts_of
from col3d.app.train import check_accelerator, make_trainer, quiet
from col3d.checks import UserError
from col3d.models.published import load_published, read_weights
from col3d.tasks import SupervisedTask


@dataclass(frozen=True)
class Subject:
    """What is scored, on which data."""

    task: SupervisedTask
    name: str
    seed: int
    data: DataOptions
    phantom: PhantomOptions


def evaluate(given: Mapping[str, Any]) -> None:
    """Rebuild network and data, and write the tables of one part of the split.

    Args:
        given: the composed configuration as plain values; see `EvaluateOptions`.

    Raises:
        UserError: an option, the checkpoint or the data breaks a rule.
    """
    quiet()
    options = check_options(EvaluateOptions, given)
    check_accelerator(options.accelerator)
    path = Path(options.checkpoint)
    subject = _published(path, options) if options.published else _trained(path, options)
    folder = Path(options.output_dir) if options.output_dir else _beside(path, options)
    data = build.data_module(subject.data, subject.phantom, subject.seed, [options.split])
    lengths = data.lengths()
    data.frames["test"] = data.frames[options.split]
    folder.mkdir(parents=True, exist_ok=True)
    facts = facts_of(subject.name, subject.seed, subject.data, options.split, options.protocol.name)
    results = Results(facts, folder, subject.data.split.name, lengths, options.panels)
    trainer = make_trainer(_machine(options), results.callbacks, [])
    trainer.test(subject.task, datamodule=data, verbose=False)
    results.write(subject.task, path, {})


def _trained(path: Path, options: EvaluateOptions) -> Subject:
    """A training's checkpoint, on the data it was trained with or on others."""
    checkpoint = _read(path)
    trained = _trained_options(checkpoint, path)
    model = trained.model.model_copy(update={"pretrained": None})
    task = build.task(trained.model_copy(update={"model": model, "protocol": options.protocol}))
    build.fill(task, checkpoint, path)
    data = _as_asked(options.data or trained.data, options)
    phantom = trained.phantom if options.data is None else options.phantom
    return Subject(task, trained.model.name, trained.seed, data, phantom)


def _published(path: Path, options: EvaluateOptions) -> Subject:
    """A checkpoint of the authors, as it is."""
    assert options.published is not None
    if options.data is None:
        raise UserError("data: published weights do not say what to score them on; take data=c3vd or phantom")
    try:
        network = load_published(options.published, _read(path), options.max_depth)
    except ValueError as error:
        raise UserError(str(error).replace("state_dict:", f"checkpoint: {path}", 1)) from None
    task = SupervisedTask(network, mirror=options.protocol.mirror)
    return Subject(task, options.published, 0, _as_asked(options.data, options), options.phantom)


def _read(path: Path) -> dict[str, Any]:
    try:
        return read_weights(path)
    except ValueError as error:
        raise UserError(str(error)) from None


def _trained_options(checkpoint: Mapping[str, Any], path: Path) -> TrainOptions:
    """The options that a checkpoint was trained with."""
    try:
        given = dict(checkpoint["hyper_parameters"]["options"])
    except (KeyError, TypeError, ValueError):
        raise UserError(
            f"checkpoint: {path} is not a checkpoint written by train.py; "
            "for the authors' weights say published=<whose>"
        ) from None
    try:
        return check_options(TrainOptions, given)
    except UserError as error:
        raise UserError(f"checkpoint: {path} was trained with options of another version: {error}") from None


def _as_asked(data: DataOptions, options: EvaluateOptions) -> DataOptions:
    asked = {name: getattr(options, name) for name in ("root", "batch_size", "workers")}
    return data.model_copy(update={name: value for name, value in asked.items() if value is not None})


def _machine(options: EvaluateOptions) -> TrainerOptions:
    """One process, whatever the training had."""
    return TrainerOptions(
        max_epochs=1,
        accelerator=options.accelerator,
        devices=1,
        strategy="auto",
        precision="32-true",
        gradient_clip=None,
        accumulate=1,
        deterministic=False,
        limit_train_batches=None,
    )


def _beside(checkpoint: Path, options: EvaluateOptions) -> Path:
    """A folder of the run that the checkpoint belongs to, named for what is scored and how."""
    run = checkpoint.parent.parent if checkpoint.parent.name == "checkpoints" else checkpoint.parent
    protocol = None if options.protocol.name == "house" else options.protocol.name
    whose = None if options.published is None else f"{options.published}_{checkpoint.stem}"
    return run / "_".join(filter(None, ("evaluation", whose, options.split, protocol)))

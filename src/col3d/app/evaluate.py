"""Predict a part of a split once, and score the predictions under any number of protocols."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from col3d.app import build
from col3d.app.compiled import compile_network
from col3d.app.config import EvaluateOptions, ProtocolOptions
from col3d.app.data_state import part_state
from col3d.app.decorations import Decorations
from col3d.app.frames import full_frames, sized_frames
from col3d.app.learnt import SHIPPED, located
from col3d.app.machine import check_accelerator, make_trainer, quiet
from col3d.app.results import Results, facts_of
from col3d.app.stopping import stoppable
from col3d.app.subject import Subject, subject_of
from col3d.app.trainer_options import TrainerOptions
from col3d.app.truth_check import has_truth
from col3d.batch import Batch, Prediction
from col3d.callbacks import SavePredictions, StopSignals
from col3d.checks import UserError
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.data.sized import SizedFrames, WithMixedTruth
from col3d.data.workers import SteadyLoader
from col3d.metrics import Protocol
from col3d.metrics.measure import try_metrics
from col3d.owned import Owned
from col3d.refusals import check_options
from col3d.reports.predictions import StoredPredictions, owned_predictions, read_facts
from col3d.reports.run_page import PAGE, write_run_page
from col3d.schema import plain

KIND = "evaluation"
FILES = ("summary.json", "per_frame.csv", PAGE)
"""What an evaluation writes, beside pictures and predictions."""


def evaluate(given: Mapping[str, Any]) -> None:
    """Rebuild network and data, and write the tables of one part of the split, for each protocol.

    Args:
        given: the composed configuration as plain values; see `EvaluateOptions`.

    Raises:
        UserError: an option, the checkpoint or the data breaks a rule.
    """
    quiet()
    options = check_options(EvaluateOptions, given)
    check_accelerator(options.accelerator)
    with stoppable("tables that are written stay, and the same command goes on") as stop:
        _evaluate(options, stop)


def _evaluate(options: EvaluateOptions, stop: StopSignals) -> None:
    subject = subject_of(options)
    height, width = subject.data.size
    try_metrics(tuple(subject.task.val_metrics), (height, width), options.metrics)
    frames = sized_frames(subject.data, subject.phantom, options.split, subject.data.size)
    subject.scored.print_audit()
    for name in options.protocol:
        owned = Owned(_folder(options, name), KIND, "output_dir")
        owned.check(FILES)
    for name, protocol in options.protocol.items():  # of all, before hours go into the first
        _check_truth(subject, frames, name, protocol, options)
    for name, protocol in options.protocol.items():
        stop.release()
        stored = _predicted(subject, frames, protocol.mirror, options)
        facts = facts_of(subject.name, subject.seed, subject.scored, name)
        folder, lengths = _folder(options, name), {str(options.split): len(frames)}
        results = Results(facts, folder, KIND, subject.scored, lengths, options.panels, protocol.average)
        scorer = replace(build.protocol(name, protocol), metrics=options.metrics)
        _score(stored, frames, scorer, protocol, subject, results)
        stop.hold()  # for seconds, after which all files of this protocol are there
        Owned(folder, KIND, "output_dir").claim(*FILES)
        results.table.save()
        summary = results.write(subject.task, Path(options.checkpoint), {})
        decorations = Decorations("the result stands; the same command makes it again")
        with decorations.one("panels"):
            results.panels.clear()
            results.panels.draw()
        with decorations.one(PAGE):
            write_run_page(folder)
        results.show(summary, Path(options.checkpoint))
    stop.asked = None  # a signal that came too late for anything to be lost by it


def _check_truth(
    subject: Subject, frames: SizedFrames, name: str, protocol: ProtocolOptions, options: EvaluateOptions
) -> None:
    """Refuse to score what nothing is known of, before anything is predicted."""
    low, high = protocol.truth_range
    if not has_truth(_truth(frames, protocol, subject, options.split), [low, high]):
        raise UserError(
            f"data.split.{options.split}: none of its {len(frames)} frames in {subject.data.root} has a "
            f"pixel of valid depth that protocol {name} counts, within {low:g} and {high:g} mm: nothing can "
            "be scored"
        )


def _predicted(
    subject: Subject, frames: SizedFrames, mirror: str | None, options: EvaluateOptions
) -> StoredPredictions:
    """The predictions for these frames, as an earlier evaluation left them or made now."""
    folder = _run(options) / _name("predictions", options, mirror)
    facts = _facts(subject, frames, mirror, options)
    if read_facts(folder) != facts:
        owned_predictions(folder).check_place()
        subject.task.mirror = mirror
        data = FrameDataModule({"test": frames}, subject.data.batch_size, subject.data.workers)
        if options.compile:
            compile_network(subject.task.network, trained=True)
        trainer = make_trainer(_machine(options), [SavePredictions(folder, facts)], [])
        trainer.test(subject.task, datamodule=data, verbose=False)
    else:
        print(f"predictions of before: {folder}", flush=True)
    return StoredPredictions(folder)


def _facts(
    subject: Subject, frames: SizedFrames, mirror: str | None, options: EvaluateOptions
) -> dict[str, Any]:
    """What predictions are of: others are made when any of it differs."""
    file = located(Path(options.checkpoint)).stat()
    data = subject.data
    return {
        "max_depth": subject.max_depth,
        "checkpoint": [options.checkpoint, file.st_size, file.st_mtime_ns],
        "data": [data.name, str(Path(data.root).absolute()), plain(data.own), data.size],
        "split": [options.split, list(getattr(data.split, options.split)), len(frames)],
        "mirror": mirror,
        "files": part_state(data, subject.phantom, options.split),
    }


def _score(
    stored: StoredPredictions,
    frames: SizedFrames,
    protocol: Protocol,
    options: ProtocolOptions,
    subject: Subject,
    results: Results,
) -> None:
    """Fill the results, frame by frame."""
    native = options.resolution == "native"
    truth = _truth(frames, options, subject, str(results.facts["split"]))
    mean = subject.task.mean_depth
    results.panels.choose(len(frames))
    for batch in SteadyLoader(truth, batch_size=1, num_workers=subject.data.workers):
        prediction = _read(stored, batch)
        values = protocol.score(prediction, batch)
        baseline = {}
        if mean is not None:
            constant: Prediction = {"depth": mean.expand_as(batch["depth"])}
            baseline = protocol.score(constant, batch, validation=True)
        results.table.add(batch, values, baseline)
        if not native:
            results.panels.keep(batch, prediction, values)


def _truth(frames: SizedFrames, options: ProtocolOptions, subject: Subject, part: str) -> Frames:
    """What a protocol holds predictions against: frames at the network's size, or else the files."""
    if options.resolution == "network" and options.truth == "clean":
        return frames
    whole = full_frames(subject.data, subject.phantom, part)
    height, width = subject.data.size
    return whole if options.resolution == "native" else WithMixedTruth(whole, (height, width))


def _read(stored: StoredPredictions, batch: Batch) -> Prediction:
    depth, normals = stored.read(batch["video"][0], int(batch["frame"][0]))

    def as_batch(values: Any) -> Tensor:
        return torch.from_numpy(values).movedim(-1, 0)[None]

    prediction: Prediction = {"depth": as_batch(depth[..., None])}
    if normals is not None:
        prediction["normals"] = as_batch(normals)
    return prediction


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
        compile=False,
        deterministic=False,
        limit_train_batches=None,
    )


def _folder(options: EvaluateOptions, protocol: str) -> Path:
    """Where the tables of a protocol go."""
    if options.output_dir is None:
        return _run(options) / _name("evaluation", options, None if protocol == "house" else protocol)
    folder = Path(options.output_dir)
    return folder if len(options.protocol) == 1 else folder / protocol


def _run(options: EvaluateOptions) -> Path:
    """The folder of the run that the checkpoint belongs to."""
    if options.checkpoint == SHIPPED:
        return Path("runs") / SHIPPED
    folder = Path(options.checkpoint).parent
    return folder.parent if folder.name == "checkpoints" else folder


def _name(kind: str, options: EvaluateOptions, variant: str | None) -> str:
    """A folder's name: what it holds, whose weights, which part, and the protocol or mirroring."""
    stem = Path(options.checkpoint).stem
    whose = f"{options.published}_{stem}" if options.published else None if stem == "best" else stem
    other = options.data and f"{options.data.name}_{options.data.split.name}"
    return "_".join(part for part in (kind, whose, other, options.split, variant) if part)

"""`col3d evaluate`: predict a part of a split once, and score it under any number of protocols."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from col3d.data.build import sized_frames
from col3d.data.checks.truth import has_truth
from col3d.data.datamodule import FrameDataModule, Frames
from col3d.errors import UserError
from col3d.evaluation.options import EvaluateOptions, ProtocolOptions
from col3d.evaluation.predict_frames import Mirror
from col3d.evaluation.prediction_files import matched_files
from col3d.evaluation.protocol_truth import own_truths
from col3d.evaluation.results import Results, facts_of
from col3d.evaluation.scorer import score, score_network, scorings_of
from col3d.evaluation.setup import EvaluationSetup, evaluation_setup, method_of, options_of_files
from col3d.inference.compiled import compile_network
from col3d.inference.trained_network import SHIPPED
from col3d.io.atomic import write_whole
from col3d.io.ownership import Owned
from col3d.io.predictions import PredictionWriter, owned_predictions
from col3d.layers.network import parameters_of
from col3d.metrics.measure import try_metrics
from col3d.registry.refusals import check_options
from col3d.reports.run_page import PAGE, write_run_page
from col3d.runs.decorations import Decorations
from col3d.runs.environment import check_accelerator, device_for, quiet
from col3d.runs.known_failures import as_user_errors
from col3d.signals import StopSignals, stoppable

KIND, CONFIG = "evaluation", "config.yaml"
FILES = ("summary.json", "per_frame.csv", PAGE)
"""Files that an evaluation writes, beside pictures and predictions."""


def evaluate(given: Mapping[str, Any]) -> None:
    """Load network and data, and write the tables of one part of the split, for each protocol.

    Args:
        given: the composed configuration as plain values; see `EvaluateOptions`.

    Raises:
        UserError: an option or the checkpoint breaks a rule.
        SystemExit: 130 or 143 after a stop signal; the same command begins again.
    """
    quiet()
    options = check_options(EvaluateOptions, given)
    check_accelerator(options.accelerator)
    with (
        stoppable("the same command begins again, and nothing of before was lost") as stop,
        as_user_errors("batch_size=1 takes the least"),
    ):
        _evaluate(options, stop)


def _evaluate(options: EvaluateOptions, stop: StopSignals) -> None:
    setup = evaluation_setup(options)
    height, width = setup.data.size
    try_metrics(setup.tasks, (height, width), options.metrics)
    frames = sized_frames(setup.data, setup.phantom, options.split, setup.data.size)
    if setup.network is not None:
        setup.scored.print_audit()
    for name in options.protocol:
        Owned(_folder(options, name), KIND, "output_dir").check(_files(options))
    truths = own_truths(options.protocol, setup.data, setup.phantom, options.split, setup.data.size)
    for name, protocol in options.protocol.items():
        _check_truth(truths[name] or frames, name, protocol, setup, options)
    device = device_for(options.accelerator)
    results = {name: _results(setup, options, name, len(frames)) for name in options.protocol}
    module = FrameDataModule({"test": frames}, setup.data.batch_size, setup.data.workers)
    scorings = scorings_of(options.protocol, options.metrics, results, truths, setup.data.workers, device)
    if setup.network is None:
        files = matched_files(options, frames)
        score(map(files.predicted, module.frames_in_order("test", device)), scorings)
    else:
        if options.compile:
            compile_network(setup.network, trained=True)
        score_network(setup.network, module, device, scorings, setup.mean_depth, _writers(setup, options))
    stop.hold()  # for the seconds in which the files are written
    for result in results.values():
        _write(setup, options, result)
    stop.pending = None  # ignore a signal that came after the work was done


def _check_truth(
    frames: Frames, name: str, protocol: ProtocolOptions, setup: EvaluationSetup, options: EvaluateOptions
) -> None:
    """Refuse frames without any valid depth in the protocol's range, before anything is predicted."""
    low, high = protocol.truth_range
    if not has_truth(frames, [low, high]):
        raise UserError(
            f"data.split.{options.split}: none of its {len(frames)} frames in {setup.data.root} has a "  # type: ignore[arg-type]
            f"pixel of valid depth that protocol {name} counts, within {low:g} and {high:g} mm: nothing can "
            "be scored"
        )


def _results(setup: EvaluationSetup, options: EvaluateOptions, name: str, frames: int) -> Results:
    facts = facts_of(setup.name, setup.seed, setup.scored, name)
    protocol, lengths = options.protocol[name], {str(options.split): frames}
    results = Results(facts, _folder(options, name), KIND, setup.scored, lengths, options.panels, protocol)
    results.panels.choose(frames)
    return results


def _writers(setup: EvaluationSetup, options: EvaluateOptions) -> dict[Mirror, PredictionWriter]:
    """Make a writer of predictions for each way of mirroring; none unless they are requested."""
    if not options.keep_predictions:
        return {}
    writers: dict[Mirror, PredictionWriter] = {}
    for mirror in dict.fromkeys(protocol.mirror for protocol in options.protocol.values()):
        folder = _run(options) / _name("predictions", options, mirror)
        owned_predictions(folder).check_place()
        facts = {"max_depth": setup.max_depth, "split": options.split, "mirror": mirror}
        writers[mirror] = PredictionWriter(folder, facts)
    return writers


def _write(setup: EvaluationSetup, options: EvaluateOptions, results: Results) -> None:
    """Write the files of one protocol."""
    folder, network = results.folder, setup.network
    Owned(folder, KIND, "output_dir").claim(*_files(options))
    results.table.save()
    parameters = 0 if network is None else parameters_of(network)
    summary = results.write(Path(options.predictions or options.weights), parameters, {})
    if network is None:  # with which a report takes it for a run
        write_whole(folder / CONFIG, yaml.safe_dump(options_of_files(options, setup), sort_keys=False))
    decorations = Decorations("the result stands; the same command makes it again")
    with decorations.attempt("panels"):
        results.panels.clear()
        results.panels.draw()
    with decorations.attempt(PAGE):
        write_run_page(folder)
    results.show(summary)


def _files(options: EvaluateOptions) -> tuple[str, ...]:
    """Return the names of the files of a protocol; scored predictions have options that a report reads."""
    return FILES if options.predictions is None else (*FILES, CONFIG)


def _folder(options: EvaluateOptions, protocol: str) -> Path:
    """Return the folder for the tables of a protocol."""
    if options.output_dir is None:
        return _run(options) / _name("evaluation", options, None if protocol == "standard" else protocol)
    folder = Path(options.output_dir)
    return folder if len(options.protocol) == 1 else folder / protocol


def _run(options: EvaluateOptions) -> Path:
    """Return the folder of the run that the checkpoint belongs to, or of the method that predicted files."""
    if options.predictions is not None:
        return Path("runs") / method_of(options)
    if options.checkpoint == SHIPPED:
        return Path("runs") / SHIPPED
    folder = options.weights.parent
    return folder.parent if folder.name == "checkpoints" else folder


def _name(kind: str, options: EvaluateOptions, variant: str | None) -> str:
    """Make a folder's name of its kind, the weights, other data, the part, and the protocol or mirroring."""
    stem = "best" if options.predictions is not None else options.weights.stem
    weights = f"{options.published}_{stem}" if options.published else None if stem == "best" else stem
    other = options.data and f"{options.data.name}_{options.data.split.name}"
    return "_".join(part for part in (kind, weights, other, options.split, variant) if part)

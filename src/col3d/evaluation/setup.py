"""Setup of an evaluation: a network with its weights, and the data to score it on."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from col3d.data.build import resolve_source_paths
from col3d.data.options import DataOptions
from col3d.errors import UserError
from col3d.evaluation.options import EvaluateOptions
from col3d.evaluation.scored_part import Scored
from col3d.inference.trained_network import MAX_DEPTH, published_network, trained_network
from col3d.layers.network import measured_tasks
from col3d.phantom.options import PhantomOptions
from col3d.runs.trained import mean_depth


@dataclass(frozen=True)
class EvaluationSetup:
    """A network in evaluation mode, or what files of predictions are named after, and the data."""

    network: nn.Module | None
    """None where files of predictions are scored."""
    tasks: tuple[str, ...]
    name: str
    seed: int
    max_depth: float
    mean_depth: Tensor | None
    """Mean depth of the training frames in mm; None if unknown."""
    data: DataOptions
    """The scored data set, with the size of frames and the options of its loader."""
    phantom: PhantomOptions
    scored: Scored


def evaluation_setup(options: EvaluateOptions) -> EvaluationSetup:
    """Load the network of a checkpoint, of a training or of the authors, and choose the data.

    Raises:
        UserError: the checkpoint is none of those, or the data are not given.
    """
    if options.predictions is not None:
        return _of_files(options)
    path = options.weights
    return _published(path, options) if options.published else _trained(path, options)


def _trained(path: Path, options: EvaluateOptions) -> EvaluationSetup:
    """Set up a training's checkpoint, on the data it was trained with or on others."""
    loaded = trained_network(path)
    trained, model = loaded.trained, loaded.trained.model
    phantom = trained.phantom if options.data is None else options.phantom
    other = options.data and options.data.model_copy(update={"size": list(trained.size_hw)})
    data = _with_overrides(other or _of_part(trained.data, options.split), options, phantom)
    scored = Scored(data, options.split, data.size, Scored.after(trained.data, options.split).trained)
    mean = mean_depth(loaded.depth_seen)
    return EvaluationSetup(
        loaded.network,
        measured_tasks(loaded.network),
        model.name,
        trained.seed,
        model.max_depth,
        mean,
        data,
        phantom,
        scored,
    )


def _of_part(data: DataOptions, part: str) -> DataOptions:
    """Return the data set that a part of a training is of, with the training's loader options."""
    if part != "test" or data.test is None:
        return data
    return data.fed(data.test)


def _published(path: Path, options: EvaluateOptions) -> EvaluationSetup:
    """Set up a checkpoint of the authors."""
    assert options.published is not None
    if options.data is None:
        raise UserError("data: published weights do not say what to score them on; take data=c3vd or phantom")
    network = published_network(path, options.published, options.max_depth)
    data = _with_overrides(options.data, options, options.phantom)
    scored = Scored.after(data, options.split)
    depth = options.max_depth or MAX_DEPTH
    return EvaluationSetup(
        network.eval(),
        measured_tasks(network),
        options.published,
        0,
        depth,
        None,
        data,
        options.phantom,
        scored,
    )


def _of_files(options: EvaluateOptions) -> EvaluationSetup:
    """Set up the data that another program predicted."""
    assert options.data is not None
    data = _with_overrides(options.data, options, options.phantom)
    tasks = ("depth", "normals") if options.reading.normals else ("depth",)
    scored = Scored(data, options.split, data.size, ())
    return EvaluationSetup(None, tasks, method_of(options), 0, MAX_DEPTH, None, data, options.phantom, scored)


def method_of(options: EvaluateOptions) -> str:
    """Name of the method that predicted files."""
    assert options.predictions is not None
    return options.reading.name or Path(options.predictions).resolve().name


def options_of_files(options: EvaluateOptions, setup: EvaluationSetup) -> dict[str, Any]:
    """What a report reads of a run: here, which method predicted, and on which data."""
    return {
        "model": {"name": setup.name},
        "loss": {"terms": {}, "lambdas": []},
        "data": setup.data.model_dump(mode="json"),
        "predictions": {"folder": options.predictions, **options.reading.model_dump(mode="json")},
    }


def _with_overrides(data: DataOptions, options: EvaluateOptions, phantom: PhantomOptions) -> DataOptions:
    overrides = {name: getattr(options, name) for name in ("root", "batch_size", "workers", "size")}
    given = {name: value for name, value in overrides.items() if value is not None}
    return resolve_source_paths(data.model_copy(update=given), phantom)

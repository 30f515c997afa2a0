"""What an evaluation scores: a network with its weights, and the data to score it on."""

from dataclasses import dataclass
from pathlib import Path

from torch import Tensor, nn

from col3d.data.build import resolve_source_paths
from col3d.data.options import DataOptions
from col3d.errors import UserError
from col3d.evaluation.options import EvaluateOptions
from col3d.evaluation.scored_part import Scored
from col3d.inference.trained_network import MAX_DEPTH, published_network, trained_network
from col3d.phantom.options import PhantomOptions
from col3d.runs.trained import mean_depth


@dataclass(frozen=True)
class EvaluationSetup:
    """A network in evaluation mode, and its data."""

    network: nn.Module
    name: str
    seed: int
    max_depth: float
    mean_depth: Tensor | None
    """Of the frames that it was trained on, in mm."""
    data: DataOptions
    """The data set that is scored, its size and how it is fed."""
    phantom: PhantomOptions
    scored: Scored


def evaluation_setup(options: EvaluateOptions) -> EvaluationSetup:
    """The network of a checkpoint, of a training or of the authors, and the data that are asked for.

    Raises:
        UserError: the checkpoint is none of those, or the data are not said.
    """
    path = Path(options.checkpoint)
    return _published(path, options) if options.published else _trained(path, options)


def _trained(path: Path, options: EvaluateOptions) -> EvaluationSetup:
    """A training's checkpoint, on the data it was trained with or on others."""
    found = trained_network(path)
    trained, model = found.trained, found.trained.model
    phantom = trained.phantom if options.data is None else options.phantom
    other = options.data and options.data.model_copy(update={"size": list(trained.size_hw)})
    data = _as_asked(other or _of_part(trained.data, options.split), options, phantom)
    scored = Scored(data, options.split, data.size, Scored.after(trained.data, options.split).trained)
    mean = mean_depth(found.depth_seen)
    return EvaluationSetup(
        found.network, model.name, trained.seed, model.max_depth, mean, data, phantom, scored
    )


def _of_part(data: DataOptions, part: str) -> DataOptions:
    """The data set that a part of a training is of, fed as the training's own."""
    if part != "test" or data.test is None:
        return data
    return data.fed(data.test)


def _published(path: Path, options: EvaluateOptions) -> EvaluationSetup:
    """A checkpoint of the authors, as it is."""
    assert options.published is not None
    if options.data is None:
        raise UserError("data: published weights do not say what to score them on; take data=c3vd or phantom")
    network = published_network(path, options.published, options.max_depth)
    data = _as_asked(options.data, options, options.phantom)
    scored = Scored.after(data, options.split)
    depth = options.max_depth or MAX_DEPTH
    return EvaluationSetup(network.eval(), options.published, 0, depth, None, data, options.phantom, scored)


def _as_asked(data: DataOptions, options: EvaluateOptions, phantom: PhantomOptions) -> DataOptions:
    asked = {name: getattr(options, name) for name in ("root", "batch_size", "workers", "size")}
    given = {name: value for name, value in asked.items() if value is not None}
    return resolve_source_paths(data.model_copy(update=given), phantom)

"""Options of the training that a checkpoint is of: network and size are checked here, the rest on use."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict
from torch import Tensor

from col3d.data.options import Data, DataOptions, Size
from col3d.errors import UserError
from col3d.models.options import Model, ModelOptions
from col3d.phantom.options import PhantomOptions
from col3d.registry import plugins
from col3d.registry.earlier import updated
from col3d.registry.refusals import check_options

DEPTH_SEEN = "depth_seen"
"""Key of the sum of the training depths in mm and their number in a checkpoint."""
Kind = TypeVar("Kind", bound=BaseModel)


class _Loose(BaseModel):
    """Base of partial options: fields that are not declared are ignored and may be of any version."""

    model_config = ConfigDict(extra="ignore", protected_namespaces=())


class _Fed(_Loose):
    size: Size


class _Network(_Loose):
    model: Model
    data: _Fed
    seed: int = 0


class _Frames(_Loose):
    data: Data
    phantom: PhantomOptions


@dataclass(frozen=True)
class Trained:
    """The options with which a checkpoint was trained.

    Attributes:
        checkpoint: path of the checkpoint.
        content: all options, converted to the current version's names.
        model: options of the network.
        size_hw: height and width of the frames.
        seed: seed of the training.
    """

    checkpoint: Path
    content: Mapping[str, Any]
    model: ModelOptions
    size_hw: tuple[int, int]
    seed: int

    @property
    def data(self) -> DataOptions:
        """Options of the data sets it was trained on.

        Raises:
            UserError: they are of another version.
        """
        return self._frames.data

    @property
    def phantom(self) -> PhantomOptions:
        """Options of the rendered data it was trained on.

        Raises:
            UserError: as of `data`.
        """
        return self._frames.phantom

    @functools.cached_property
    def _frames(self) -> _Frames:
        return checked_options(_Frames, self.content, self.checkpoint)

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the data sets it was trained on."""
        data = self.content["data"]
        also = data.get("also")
        sources = (data, *(also.values() if isinstance(also, Mapping) else ()))
        return tuple(
            dict.fromkeys(str(source.get("name")) for source in sources if isinstance(source, Mapping))
        )


def trained_options(checkpoint: Mapping[str, Any], path: Path) -> Trained:
    """Read the options that a checkpoint was trained with.

    Raises:
        UserError: it holds none, parts of a plugin that is not loaded, or a network of another version.
    """
    try:
        given = dict(checkpoint["hyper_parameters"]["options"])
    except (KeyError, TypeError, ValueError):
        raise UserError(
            f"checkpoint: {path} is not a checkpoint written by train.py; "
            "for the authors' weights say published=<whose>"
        ) from None
    if absent := sorted({str(name) for name in given.get("plugins") or ()} - {*plugins.load()}):
        raise UserError(
            f"checkpoint: {path} was trained with parts of {', '.join(absent)}; add "
            f"plugins=[{','.join(absent)}], or name them in {plugins.VARIABLE}"
        )
    content = updated(given)
    network = checked_options(_Network, content, path)
    height, width = network.data.size
    return Trained(path, content, network.model, (height, width), network.seed)


def checked_options(kind: type[Kind], content: Mapping[str, Any], path: Path) -> Kind:
    """Validate those options of a checkpoint that a class of options declares.

    Raises:
        UserError: they are of another version.
    """
    try:
        return check_options(kind, content)
    except UserError as error:
        raise UserError(f"checkpoint: {path} was trained with options of another version: {error}") from None


def depth_seen(checkpoint: Mapping[str, Any]) -> Tensor:
    """Read the sum of a training's depths in mm and their number, which may also be among the weights.

    Raises:
        ValueError: it is no pair of numbers.
    """
    kept = checkpoint.get(DEPTH_SEEN, checkpoint["state_dict"].get(DEPTH_SEEN))
    if not (isinstance(kept, Tensor) and kept.shape == (2,) and bool(kept.isfinite().all())):
        raise ValueError(f"{DEPTH_SEEN} must be a sum and a number, got {kept!r}")
    return kept.double().cpu()


def mean_depth(seen: Tensor) -> Tensor | None:
    """Return the mean depth of the training frames in mm; None before any training."""
    total, pixels = seen
    return (total / pixels).float() if pixels > 0 else None

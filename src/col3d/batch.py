"""Types of the batch and prediction dictionaries: every key with its shape, unit and range.

A `Batch` is what a data set yields after collation; a single item is the same without the batch axis.
A `Prediction` is what every network returns.
"""

from collections.abc import Mapping
from typing import NotRequired, TypedDict

from jaxtyping import Bool, Float, Int
from torch import Tensor

from col3d.errors import UserError


class Batch(TypedDict):
    """Frames in standard units; `col3d.geometry` states the conventions of axes and pixels."""

    image: Float[Tensor, "b 3 h w"]
    """RGB in [0, 1]; networks normalise inside."""
    depth: Float[Tensor, "b 1 h w"]
    """Depth along the optical axis in mm; 0 where unknown."""
    normals: NotRequired[Float[Tensor, "b 3 h w"]]
    """Unit vectors facing the camera (n . ray < 0); the zero vector where unknown, see `normals_mask`."""
    mask: Bool[Tensor, "b 1 h w"]
    """True where depth is known: only these pixels count."""
    rays: Float[Tensor, "b 3 h w"]
    """Unit viewing directions; they rotate and mirror with the image."""
    video: list[str]
    """Name of the video of each frame."""
    frame: Int[Tensor, " b"]
    """Number of each frame inside its video."""


class Prediction(TypedDict):
    """The output of a network for a batch of images."""

    depth: Float[Tensor, "b 1 h w"]
    """Depth along the optical axis in mm, in (0, max_depth)."""
    normals: NotRequired[Float[Tensor, "b 3 h w"]]
    """Unit vectors in camera axes."""


def normals_mask(batch: Batch) -> Bool[Tensor, "b 1 h w"]:
    """True where normals are known: a subset of `mask`, without pixels where none could be derived."""
    return batch["mask"] & (batch["normals"] != 0).any(dim=1, keepdim=True)


def check_prediction(prediction: object, image: Tensor, network: str) -> None:
    """Refuse a network's output that is no `Prediction` for images (b, 3, h, w).

    Raises:
        UserError: names the network, what it has to return and what it returned.
    """
    expected = {"depth": (len(image), 1, *image.shape[2:]), "normals": (len(image), 3, *image.shape[2:])}
    given = prediction if isinstance(prediction, Mapping) else {"depth": prediction}
    sizes = {name: _size(given[name]) for name in expected if name in given}
    wrong = [name for name in sizes if sizes[name] != str(expected[name])]
    if isinstance(prediction, Mapping) and "depth" in sizes and not wrong:
        return
    got = ", ".join(f"{name} {sizes[name]}" for name in wrong) or f"a dict of {sorted(map(str, given))}"
    got = got if isinstance(prediction, Mapping) else type(prediction).__name__
    raise UserError(
        f"model: {network} has to return a dict with depth {expected['depth']} for images {_size(image)}; "
        f"got {got}"
    )


def check_maps(preds: Tensor, target: Tensor, mask: Tensor) -> None:
    """Refuse maps of different shapes, which broadcasting would combine into a wrong number.

    Raises:
        ValueError: `target` has another shape than `preds`, or `mask` is not (b, 1, h, w) of the same size.
    """
    if preds.ndim != 4 or preds.shape != target.shape:
        raise ValueError(
            f"preds, target: expected one shape (b, c, h, w), got {_size(preds)} and {_size(target)}"
        )
    if mask.shape != (preds.shape[0], 1, *preds.shape[2:]):
        raise ValueError(f"mask: expected (b, 1, h, w) of preds {_size(preds)}, got {_size(mask)}")


def _size(value: object) -> str:
    return str(tuple(value.shape)) if isinstance(value, Tensor) else type(value).__name__

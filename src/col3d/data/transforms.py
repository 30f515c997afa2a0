"""Transforms of batches that keep image, depth, normals, mask and rays consistent.

A pixel is valid after a transform only where all pixels it is interpolated from are, or, of truth with holes,
where the nearest one is; vectors turn and mirror with the image. kornia warps the maps but leaves the vectors
in them as they are; they are rotated here.
"""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import Batch
from col3d.data.resize import WHOLE
from col3d.geometry import unit


def flip(batch: Batch, chosen: Bool[Tensor, " b"]) -> Batch:
    """Mirror the chosen frames left to right; x of their normals and rays changes its sign."""
    where = chosen[:, None, None, None]
    moved = {key: torch.where(where, value.flip(-1), value) for key, value in _maps(batch).items()}
    for key in ("normals", "rays"):
        if key in moved:
            moved[key] = torch.where(where, torch.cat([-moved[key][:, :1], moved[key][:, 1:]], 1), moved[key])
    return batch | moved  # type: ignore[return-value]


def rotate(batch: Batch, degrees: Float[Tensor, " b"], sparse: bool = False) -> Batch:
    """Rotate each frame about its middle, from x towards y, and its vectors with it.

    Where pixels are not square (frames squeezed to 320 x 320), the map of the pixels allows for it, so that
    the scene turns rigidly about the optical axis.

    Args:
        batch: frames.
        degrees: one angle a frame.
        sparse: whether the truth has holes.
    """
    move = _pixel_rotation(degrees, _size_hw(batch), _pixel_aspect(batch["rays"]))
    return _warp(batch, move, lambda vectors: _turn(vectors, degrees), sparse)


def crop(batch: Batch, share: float, place: Float[Tensor, "b 2"], sparse: bool = False) -> Batch:
    """Cut a window out of each frame and enlarge it to the frame's size; depth, normals and rays are kept.

    Args:
        batch: frames.
        share: side of the window as a share of the frame's.
        place: place of the window, from (0, 0) at the top left to (1, 1) at the bottom right.
        sparse: whether the truth has holes.
    """
    size_hw = _size_hw(batch)
    # Edges of the frame are half a pixel outside the outermost centres.
    room = _pair(place, float(size_hw[1]), float(size_hw[0])) * (1 - share)
    offset = (place.flip(-1) * room + (share - 1) / 2) / -share
    scale = torch.eye(2, device=place.device).expand(len(place), 2, 2) / share
    return _warp(batch, torch.cat([scale, offset[..., None]], dim=-1), lambda vectors: vectors, sparse)


def _warp(
    batch: Batch, move: Float[Tensor, "b 2 3"], turn: Callable[[Tensor], Tensor], sparse: bool
) -> Batch:
    """Move pixels by affine maps, and turn vectors with them."""
    from kornia.geometry.transform import warp_affine

    size_hw = _size_hw(batch)

    def warp(values: Tensor, padding: str, mode: str = "bilinear") -> Tensor:
        return warp_affine(values.float(), move, size_hw, mode, padding_mode=padding, align_corners=True)

    mask = warp(batch["mask"], "zeros") > WHOLE
    moved = {
        "image": warp(batch["image"], "border"),
        "depth": torch.where(mask, warp(batch["depth"], "border"), 0.0),
        "mask": mask,
        "rays": unit(turn(warp(batch["rays"], "border"))),
    }
    if "normals" in batch:
        moved["normals"] = torch.where(mask, unit(turn(warp(batch["normals"], "border"))), 0.0)
    if sparse:
        nearest = warp(batch["mask"], "zeros", "nearest") > 0
        moved["mask"] = mask | nearest
        moved["depth"] = torch.where(
            nearest & ~mask, warp(batch["depth"], "border", "nearest"), moved["depth"]
        )
        if "normals" in batch:
            turned = turn(warp(batch["normals"], "border", "nearest"))
            moved["normals"] = torch.where(nearest & ~mask, turned, moved["normals"])
    return batch | moved  # type: ignore[return-value]


def _size_hw(batch: Batch) -> tuple[int, int]:
    return int(batch["image"].shape[-2]), int(batch["image"].shape[-1])


def jitter(
    image: Float[Tensor, "b 3 h w"], gamma: Float[Tensor, " b"], gains: Float[Tensor, "b 3"]
) -> Float[Tensor, "b 3 h w"]:
    """Photometric change: image ** gamma, times a gain for each colour, clipped to [0, 1]."""
    return (image.clamp_min(1e-6) ** gamma[:, None, None, None] * gains[:, :, None, None]).clamp(0, 1)


@dataclass(frozen=True)
class Augment:
    """Random transforms of a batch on its device, by numbers that are drawn on the host.

    The defaults are the paper's set: rotation only.
    """

    rotation: float = 1.0
    """Largest rotation in degrees, either way."""
    flip: float = 0.0
    """Probability of mirroring."""
    crop: float = 1.0
    """Share of either side that is kept, anywhere in the frame, and enlarged to its size."""
    jitter: float = 0.0
    """Probability of a photometric change: gamma 0.9..1.1, brightness 0.75..1.25, colours 0.9..1.1."""
    sparse: bool = False
    """Whether the truth has holes; see `Resize`."""

    def __call__(self, batch: Batch, draws: Float[Tensor, "b 10"]) -> Batch:
        """The batch as the numbers say, those of `draws_of` on its device."""
        if self.flip:
            batch = flip(batch, draws[:, 0] < self.flip)
        if self.rotation:
            batch = rotate(batch, self.rotation * (2 * draws[:, 1] - 1), self.sparse)
        if self.crop < 1:
            batch = crop(batch, self.crop, draws[:, 8:10], self.sparse)
        if self.jitter:
            chosen = draws[:, 2] < self.jitter
            gamma = torch.where(chosen, 0.9 + 0.2 * draws[:, 3], 1.0)
            gains = (0.75 + 0.5 * draws[:, 4:5]) * (0.9 + 0.2 * draws[:, 5:8])
            image = jitter(batch["image"], gamma, torch.where(chosen[:, None], gains, 1.0))
            batch = batch | {"image": image}
        return batch


def draws_of(batch: Mapping[str, Any], seed: int, epoch: int) -> Float[Tensor, "b 10"]:
    """Ten uniform numbers a frame, on the host: of (seed, epoch, video, frame) alone, whatever the batch is.

    Args:
        batch: `video` and `frame` of its frames; numbers that are on a device already have to be waited for.
        seed: of the training.
        epoch: of the training.
    """
    rows = []
    for video, frame in zip(batch["video"], batch["frame"].tolist(), strict=True):
        key = zlib.crc32(f"{seed}/{epoch}/{video}/{frame}".encode())
        rows.append(torch.rand(10, generator=torch.Generator().manual_seed(key)))
    return torch.stack(rows)


def _maps(batch: Batch) -> dict[str, Tensor]:
    return {k: v for k, v in batch.items() if isinstance(v, Tensor) and v.ndim == 4}


def _turn(vectors: Tensor, degrees: Tensor) -> Tensor:
    """Rotate vectors about the optical axis, from x towards y."""
    cos, sin = (f(torch.deg2rad(degrees))[:, None, None] for f in (torch.cos, torch.sin))
    x, y, z = vectors.unbind(dim=1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=1)


def _pixel_aspect(rays: Float[Tensor, "b 3 h w"]) -> Float[Tensor, ""]:
    """Width of a pixel over its height, as angles, at the middle of the image; the same for all frames."""
    v, u = rays.shape[-2] // 2, rays.shape[-1] // 2
    first = rays[0]
    across = (first[:, v, u + 1] - first[:, v, u - 1]).norm()
    return across / (first[:, v + 1, u] - first[:, v - 1, u]).norm()


def _pair(like: Tensor, x: float, y: float) -> Float[Tensor, " 2"]:
    """Two numbers, filled in on the device: a copy from the host would wait for it."""
    return torch.stack([like.new_full((), x), like.new_full((), y)])


def _pixel_rotation(degrees: Tensor, size_hw: tuple[int, int], aspect: Tensor) -> Float[Tensor, "b 2 3"]:
    """Affine maps of pixels: a rotation about the middle where pixels are `aspect` times as wide as high."""
    middle = _pair(degrees, (size_hw[1] - 1) / 2, (size_hw[0] - 1) / 2)
    radians = degrees * (math.pi / 180)
    cos, sin = radians.cos(), radians.sin()
    linear = torch.stack([cos, -sin / aspect, sin * aspect, cos], dim=-1).unflatten(-1, (2, 2))
    return torch.cat([linear, (middle - linear @ middle)[..., None]], dim=-1)

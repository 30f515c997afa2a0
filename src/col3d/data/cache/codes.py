"""Integer codes of frames: their form in a store and on the way to the device that decodes them.

A pixel takes 10 bytes: the image as it is, 8 bits a colour; depth in 65535 steps of its largest value; a
normal as two 16-bit coordinates on an octahedron; and the mask. Depth of up to 100 mm is exact to 0.0008 mm,
normals to 0.004 degrees.

References:
    Cigolle, Donow, Evangelakos, Mara, McGuire, Meyer: A Survey of Efficient Representations for Independent
    Unit Vectors, Journal of Computer Graphics Techniques 3(2), 2014, section 3 (octahedral).
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NotRequired, TypedDict

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Int16, UInt8
from torch import Tensor

from col3d.batch import Batch
from col3d.geometry import Camera

DEPTH_STEPS, NORMAL_STEPS = 65535, 32767
NO_NORMAL = -32768
WORST_ANGLE = 0.004
"""Degrees by which a decoded normal may differ from the one that was encoded."""


ARRAYS: dict[str, tuple[int | None, str, torch.dtype]] = {
    "image": (3, np.dtype(np.uint8).str, torch.uint8),
    "depth": (None, np.dtype("<u2").str, torch.int16),
    "normals": (2, np.dtype("<i2").str, torch.int16),
    "mask": (None, np.dtype(np.bool_).str, torch.bool),
}
"""Channels (None: no such axis), type on disk and type in memory of each array."""


def shapes(size_hw: tuple[int, int], normals: bool) -> Mapping[str, tuple[tuple[int, ...], str]]:
    """Shape and type on disk of one frame in each array."""
    return {
        name: (size_hw if channels is None else (channels, *size_hw), stored)
        for name, (channels, stored, _) in ARRAYS.items()
        if normals or name != "normals"
    }


class QuantizedBatch(TypedDict):
    """Frames of one size; `decode` makes a `Batch` of them."""

    image: UInt8[Tensor, "b 3 h w"]
    """RGB."""
    depth: Int16[Tensor, "b h w"]
    """The bits of an unsigned code, of which 65535 is `max_depth`."""
    normals: NotRequired[Int16[Tensor, "b 2 h w"]]
    """Octahedral coordinates, of which 32767 is 1; `NO_NORMAL` where depth is known and the normal is not."""
    mask: Bool[Tensor, "b h w"]
    """True where depth is known."""
    max_depth: Float[Tensor, " b"]
    """Millimetres."""
    lens: Int[Tensor, " b"]
    """Index of the camera, among the cameras that come with the frames."""
    video: list[str]
    frame: Int[Tensor, " b"]


def encode(item: dict[str, Any], max_depth: float) -> dict[str, Tensor]:
    """Encode the maps of one item as arrays of a `QuantizedBatch`, without the axis b.

    Args:
        item: image uint8 (3, h, w), depth (1, h, w) in mm, mask (1, h, w), and perhaps normals (3, h, w).
        max_depth: depth in mm of the highest code.
    """
    steps = torch.round(item["depth"][0] * (DEPTH_STEPS / max_depth)).clamp(0, DEPTH_STEPS).int()
    codes = {
        "image": item["image"].contiguous(),
        # The unsigned code wraps round into the sixteen bits that it has.
        "depth": torch.where(steps > NORMAL_STEPS, steps - (DEPTH_STEPS + 1), steps).short(),
        "mask": item["mask"][0],
    }
    if "normals" in item:
        missing = item["mask"] & ~(item["normals"] != 0).any(dim=0, keepdim=True)
        codes["normals"] = octahedral(item["normals"]).masked_fill_(missing, NO_NORMAL)
    return codes


def decode(codes: QuantizedBatch, cameras: Sequence[Camera]) -> Batch:
    """Decode frames to standard units, on the device of the codes.

    Args:
        codes: encoded frames.
        cameras: the cameras that `lens` is an index of, all of one size.
    """
    device, mask = codes["mask"].device, codes["mask"][:, None]
    known = mask.float()
    scale = (codes["max_depth"] / DEPTH_STEPS)[:, None, None]
    depth = (codes["depth"].int() & DEPTH_STEPS).float().mul_(scale)
    rays = torch.stack([_rays_on(camera, device) for camera in cameras])
    batch: dict[str, Any] = {
        "image": codes["image"].float().div_(255),
        "depth": depth[:, None].mul_(known),
        "mask": mask,
        "rays": rays[codes["lens"]],
        "video": codes["video"],
        "frame": codes["frame"],
    }
    if "normals" in codes:
        has_normal = codes["normals"][:, :1] != NO_NORMAL
        batch["normals"] = from_octahedral(codes["normals"]).mul_(mask & has_normal)
    return batch  # type: ignore[return-value]


@lru_cache(maxsize=16)
@torch.inference_mode(False)  # rays of a first call in validation must serve training, too
def _rays_on(camera: Camera, device: torch.device) -> Tensor:
    return camera.rays().to(device)


def octahedral(normals: Float[Tensor, "3 h w"]) -> Int16[Tensor, "2 h w"]:
    """Encode unit vectors as two coordinates; those towards the camera, n_z < 0, are mid-square."""
    total = normals.abs().sum(dim=0).clamp_min(1e-12)
    x, y, z = normals / total
    away = z > 0
    folded = torch.stack([_signed(1 - y.abs(), x), _signed(1 - x.abs(), y)])
    square = torch.where(away, folded, torch.stack([x, y]))
    return torch.round(square * NORMAL_STEPS).short()


def from_octahedral(codes: Int16[Tensor, "b 2 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Decode unit vectors, float32."""
    x, y = codes.float().unbind(dim=1)
    right, down = x.abs(), y.abs()
    z = (right + down).sub_(NORMAL_STEPS)
    fold = z.clamp_min(0)
    right, down = right.sub_(fold), down.sub_(fold)
    # Never zero: right + down + |z| is NORMAL_STEPS.
    scale = right.square().addcmul_(down, down).addcmul_(z, z).rsqrt_()
    return torch.stack([right.copysign_(x), down.copysign_(y), z], dim=1).mul_(scale[:, None])


def _signed(size: Tensor, like: Tensor) -> Tensor:
    """`size` with the sign of `like`, 0 counted as positive."""
    return torch.where(like < 0, -size, size)

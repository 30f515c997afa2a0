"""Resizing of items, whole or straight from the pixels of their files that count."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor
from torch.nn.functional import interpolate

from col3d.data.frames import FrameSet
from col3d.geometry import Camera
from col3d.geometry.normals import unit_in_place

WHOLE = 0.999
"""Share of valid pixels, up to rounding, from which an interpolated pixel counts as valid."""


@dataclass(frozen=True)
class Resize:
    """Resize items to `size_hw`, aspect not kept.

    The image is averaged (bilinear, antialiased) in 8 bits. Depth and normals are read off at the new pixel
    centres between the four pixels around, so that neither edges nor the borders of the mask bleed; normals
    get unit length again. The rays are those of the resized camera.
    """

    size_hw: tuple[int, int]
    camera: Camera
    """Camera of the items before."""
    truth: str = "clean"
    """"clean" as above; "mixed" as published programs score: between all four pixels, zeros of unknown ones
    included, and known wherever the mean depth is above 0."""

    @property
    def resized_camera(self) -> Camera:
        """Camera of the items after."""
        return self.camera.resized(self.size_hw)

    def __call__(self, item: dict[str, Any]) -> dict[str, Any]:
        """The resized item of a whole one, its image in [0, 1]."""
        maps: list[str] = [key for key in ("depth", "mask", "normals") if key in item]
        whole = {key: item[key].movedim(0, -1).numpy() for key in maps}
        taken = {key: torch.from_numpy(self.take(whole[key])).movedim(-1, 0) for key in maps}
        image = self._image((item["image"] * 255).round().to(torch.uint8))
        return {
            **item,
            "image": image.float() / 255,
            **self._between(taken),
            "rays": self.resized_camera.rays(),
        }

    def read(self, frames: FrameSet, index: int) -> dict[str, Any]:
        """The resized item of a frame: its image uint8, no rays; pixels that do not count stay undecoded."""
        frame = frames.frames[index]
        image = self._image(torch.from_numpy(frames.image(index)).permute(2, 0, 1))
        truth = self._between(frames.truth(index, self.take))
        return {"image": image, **truth, "video": frame.video, "frame": frame.number}

    def take(self, values: np.ndarray) -> np.ndarray:
        """The pixels around new centres of an array (h, w) or (h, w, c): twice the new height and width."""
        (rows, _), (columns, _) = self._around
        return values.take(rows, axis=0).take(columns, axis=1)

    def _image(self, image: UInt8[Tensor, "3 h w"]) -> UInt8[Tensor, "3 h2 w2"]:
        return resized_image(image[None], self.size_hw)[0]

    def _between(self, taken: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Depth, mask and normals from those of the pixels around."""
        mixed = self.truth == "mixed"
        depth = self._read_off(taken["depth"])
        mask = depth > 0 if mixed else self._read_off(taken["mask"].float()) > WHOLE
        found = {"depth": torch.where(mask, depth, 0.0), "mask": mask}
        if "normals" in taken:
            between = self._read_off(taken["normals"])
            found["normals"] = (between if mixed else unit_in_place(between)).mul_(mask)
        return found

    def _read_off(self, values: Float[Tensor, "c h w"]) -> Float[Tensor, "c h2 w2"]:
        (_, down), (_, across) = self._around
        upper, lower = values.unflatten(1, (-1, 2)).unbind(dim=2)
        left, right = torch.lerp(upper, lower, down[:, None]).unflatten(2, (-1, 2)).unbind(dim=3)
        return torch.lerp(left, right, across)

    @cached_property
    def _around(self) -> tuple[tuple[np.ndarray, Tensor], tuple[np.ndarray, Tensor]]:
        """Along height and width: pixels before and after each new centre, and its place between them."""
        return tuple(map(_neighbours, self.camera.size_hw, self.size_hw))  # type: ignore[return-value]


def resized_image(image: UInt8[Tensor, "b 3 h w"], size_hw: tuple[int, int]) -> UInt8[Tensor, "b 3 h2 w2"]:
    """Images averaged to a size as networks see them: bilinear, antialiased, in 8 bits."""
    return interpolate(image, size_hw, mode="bilinear", antialias=True)


def _neighbours(old: int, new: int) -> tuple[np.ndarray, Float[Tensor, " n"]]:
    centres = ((np.arange(new) + 0.5) * (old / new) - 0.5).clip(0, old - 1)
    before = np.floor(centres).astype(np.int64)
    pairs = np.stack([before, np.minimum(before + 1, old - 1)], axis=1)
    return pairs.reshape(-1), torch.from_numpy((centres - before).astype(np.float32))

"""Resize items, from whole frames or only from the pixels of their files that count."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor
from torch.nn.functional import interpolate

from col3d.data.datasets.frame_set import FrameSet
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

    That leaves out every new pixel one of whose four is unknown: right for the border of a field of view, but
    of truth with holes (structured light, stereo, points of a reconstruction) hardly anything would stay.
    Where a data set's truth is not dense, `read` gives a new pixel whose four are not all known what the
    nearest known pixel inside it has.
    """

    size_hw: tuple[int, int]
    camera: Camera
    """Camera of the original items."""
    truth: str = "clean"
    """"clean" as above; "mixed" as published programs score: between all four pixels, zeros of unknown ones
    included, and known wherever the mean depth is above 0; "area": depth by OpenCV's INTER_AREA, known where
    the nearest pixel is."""

    @property
    def resized_camera(self) -> Camera:
        """Camera of the resized items."""
        return self.camera.resized(self.size_hw)

    def __call__(self, item: dict[str, Any]) -> dict[str, Any]:
        """Resize a whole item, its image in [0, 1]."""
        image = self._image((item["image"] * 255).round().to(torch.uint8))
        truth = self._resized({key: item[key] for key in ("depth", "mask", "normals") if key in item})
        if self.truth == "area":
            truth |= self._averaged(item["depth"], item["mask"])
        return {
            **item,
            "image": image.float() / 255,
            **truth,
            "rays": self.resized_camera.rays(),
        }

    def read(self, frames: FrameSet, index: int) -> dict[str, Any]:
        """Read a frame resized: its image uint8, no rays; pixels that do not count stay undecoded."""
        frame = frames.frames[index]
        image = self._image(torch.from_numpy(frames.image(index)).permute(2, 0, 1))
        if frames.dense_truth:
            truth = self._between(frames.truth(index, self.take))
        else:
            whole = frames.truth(index)
            truth = self._filled(self._resized(whole), whole)
        return {"image": image, **truth, "video": frame.video, "frame": frame.number}

    def take(self, values: np.ndarray) -> np.ndarray:
        """Select the pixels around new centres in (h, w) or (h, w, c): twice the new height and width."""
        (rows, _), (columns, _) = self._around
        return values.take(rows, axis=0).take(columns, axis=1)

    def _image(self, image: UInt8[Tensor, "3 h w"]) -> UInt8[Tensor, "3 h2 w2"]:
        return resized_image(image[None], self.size_hw)[0]

    def _resized(self, whole: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Depth, mask and normals, resized from those of all pixels."""
        maps = {key: values.movedim(0, -1).numpy() for key, values in whole.items()}
        return self._between(
            {key: torch.from_numpy(self.take(values)).movedim(-1, 0) for key, values in maps.items()}
        )

    def _averaged(self, depth: Tensor, mask: Tensor) -> dict[str, Tensor]:
        """Depth averaged over areas, and a mask of the nearest pixels."""
        width_height = self.size_hw[::-1]
        averaged = cv2.resize(depth[0].numpy(), width_height, interpolation=cv2.INTER_AREA)
        nearest = cv2.resize(mask[0].to(torch.uint8).numpy(), width_height, interpolation=cv2.INTER_NEAREST)
        known = torch.from_numpy(nearest > 0)[None]
        return {"depth": torch.where(known, torch.from_numpy(averaged)[None], 0.0), "mask": known}

    def _filled(self, between: Mapping[str, Tensor], whole: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Maps in which pixels without four known neighbours have the value of the nearest known pixel."""
        filled = dict(between)
        if not bool(between["mask"].all()):
            nearest = self._nearest(whole["mask"][0])
            take = (nearest >= 0) & ~between["mask"]
            filled["depth"] = torch.where(take, whole["depth"].flatten()[nearest], between["depth"])
            filled["mask"] = between["mask"] | take
        if "normals" in whole and bool((missing := (between["normals"] == 0).all(dim=0, keepdim=True)).any()):
            nearest = self._nearest((whole["mask"] & (whole["normals"] != 0).any(dim=0, keepdim=True))[0])
            normals = whole["normals"].flatten(1)[:, nearest]
            filled["normals"] = torch.where((nearest >= 0) & missing, normals, between["normals"])
        return filled

    def _nearest(self, known: Bool[Tensor, "h w"]) -> Int[Tensor, "h2 w2"]:
        """For each new pixel, index of the known pixel inside it nearest to its centre; -1 where none is."""
        inside, order = self._inside
        chosen = order[known.flatten()[order]]
        height, width = self.size_hw
        nearest = torch.full((height * width,), -1)
        nearest[inside[chosen]] = chosen
        below = self._below_centres
        nearest = torch.where((nearest < 0) & known.flatten()[below], below, nearest)
        return nearest.view(self.size_hw)

    @cached_property
    def _inside(self) -> tuple[Int[Tensor, " n"], Int[Tensor, " n"]]:
        """The new pixel that contains each old pixel, and an order in which nearer ones come later."""
        (rows, down), (columns, across) = map(_cells, self.camera.size_hw, self.size_hw)
        inside = (rows[:, None] * self.size_hw[1] + columns).flatten()
        far = (down[:, None].square() + across.square()).flatten()
        return inside, far.argsort(descending=True, stable=True)

    @cached_property
    def _below_centres(self) -> Int[Tensor, " n"]:
        """The old pixel that contains the centre of each new one."""
        rows, columns = (
            torch.arange(new).mul(2).add(1).mul(old).div(2 * new, rounding_mode="floor")
            for old, new in zip(self.camera.size_hw, self.size_hw, strict=True)
        )
        return (rows[:, None] * self.camera.size_hw[1] + columns).flatten()

    def _between(self, taken: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Depth, mask and normals interpolated from those of the four pixels around."""
        mixed = self.truth == "mixed"
        depth = self._read_off(taken["depth"])
        mask = depth > 0 if mixed else self._read_off(taken["mask"].float()) > WHOLE
        maps = {"depth": torch.where(mask, depth, 0.0), "mask": mask}
        if "normals" in taken:
            between = self._read_off(taken["normals"])
            maps["normals"] = (between if mixed else unit_in_place(between)).mul_(mask)
        return maps

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
    """Resize images as networks see them: bilinear, antialiased, in 8 bits."""
    return interpolate(image, size_hw, mode="bilinear", antialias=True)


def _cells(old: int, new: int) -> tuple[Int[Tensor, " n"], Float[Tensor, " n"]]:
    """The new pixel that contains each old one, and its distance from the centre in old pixels."""
    place = torch.arange(old)
    cell = ((2 * place + 1) * new).div(2 * old, rounding_mode="floor")
    return cell, place - ((cell.double() + 0.5) * (old / new) - 0.5)


def _neighbours(old: int, new: int) -> tuple[np.ndarray, Float[Tensor, " n"]]:
    centres = ((np.arange(new) + 0.5) * (old / new) - 0.5).clip(0, old - 1)
    before = np.floor(centres).astype(np.int64)
    pairs = np.stack([before, np.minimum(before + 1, old - 1)], axis=1)
    return pairs.reshape(-1), torch.from_numpy((centres - before).astype(np.float32))

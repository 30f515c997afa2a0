"""Find the axes, signs and encoding of stored normals, and the camera that they were made for.

Every way to store a normal is tried: six orders of the axes, eight choices of signs, and two encodings, all
three in -1..1, or z in 0..1 with what is negative cut off, as the release before May 2023 has it. Each is
compared with the normals of the depth, once through the data set's own lens and once through the pinhole of
published code.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32

from col3d.data.datasets.frame_set import Depth
from col3d.data.datasets.release import FULL_CODE, in_blocks, stored_somewhere
from col3d.geometry import Camera, PinholeCamera, normals_from_depth

CAMERAS = ("lens", "pinhole")
ENCODINGS: tuple[int | None, ...] = (None, 0, 1, 2)
"""The channel that holds z with its negative values cut off; None where all three are in -1..1."""
SIGNS = np.array(list(product((1, -1), repeat=3)), np.float32)
ENOUGH, PLENTY = 20, 4000
"""Least number of blocks of a frame for a result, and the number beyond which blocks are thinned out."""
OF_RELEASE = {"x, y, z": "current", "x, -y, max(-z, 0)": "pre_2023_05"}


@dataclass(frozen=True)
class Convention:
    """One way to store normals.

    Attributes:
        camera: camera of the depth's normals, one of `CAMERAS`.
        clipped: the channel whose negative values are cut off, or None.
        channels: content of red, green and blue, in standard axes.
    """

    camera: str
    clipped: int | None
    channels: str

    @property
    def release(self) -> str:
        """The release of C3VD that stores normals by this convention; empty where none does."""
        return OF_RELEASE.get(self.channels, "") if self.camera == "lens" else ""

    @property
    def called(self) -> str:
        """The convention in words, with its camera."""
        return str(self) if self.camera == "lens" else f"{self} of a pinhole"

    def __str__(self) -> str:
        return f"({self.channels})"


def _orders(clipped: int | None) -> list[tuple[int, ...]]:
    """Orders of axes: for each of x, y and z the channel that holds it."""
    return [order for order in permutations(range(3)) if clipped in (None, order[2])]


def _conventions() -> Iterator[Convention]:
    for camera, clipped in product(CAMERAS, ENCODINGS):
        for order, signs in product(_orders(clipped), SIGNS):
            held = {
                channel: f"{'-' if signs[axis] < 0 else ''}{'xyz'[axis]}"
                for axis, channel in enumerate(order)
            }
            names = [f"max({held[c]}, 0)" if c == clipped else held[c] for c in range(3)]
            yield Convention(camera, clipped, ", ".join(names))


CONVENTIONS = tuple(_conventions())


def angles_of(codes: np.ndarray, depth: Depth, camera: Camera) -> Float32[np.ndarray, " c"] | None:
    """Median angle in degrees of stored normals to those of the depth under each of `CONVENTIONS`.

    Both are averaged over blocks first, so that depth in steps of 0.4 mm suffices.

    Args:
        codes: (h, w, 3) as stored, red first.
        depth: depth of the frame.
        camera: camera of the data set.

    Returns:
        The angles; None where too little is known.
    """
    known = depth.known & stored_somewhere(*np.moveaxis(codes, -1, 0))
    stored, mm, whole = (_blocks(values, camera) for values in (codes, np.where(known, depth.mm, 0), known))
    certain = whole == 1
    medians = []
    for through in (camera, PinholeCamera.c3vd().resized(camera.size_hw)):
        derived = _normals(mm, certain, in_blocks(through)[1])
        ok = np.flatnonzero(derived.any(axis=-1))
        if len(ok) < ENOUGH:
            return None
        ok = ok[:: -(-len(ok) // PLENTY)]
        medians.append(_medians(stored.reshape(-1, 3)[ok] / FULL_CODE, derived.reshape(-1, 3)[ok]))
    return np.concatenate(medians)


def off_lengths(codes: np.ndarray, known: np.ndarray, tolerance: float) -> tuple[float, ...]:
    """Share of the stored normals, one pixel of four, without unit length, under each of `ENCODINGS`.

    Where z is cut off to 0, the length of the other two may be anything up to 1.
    """
    few = codes[::2, ::2]
    chosen = few[known[::2, ::2] & stored_somewhere(*np.moveaxis(few, -1, 0))]
    if not len(chosen):
        return ()
    values = [np.ascontiguousarray(chosen[:, channel], np.float32) / FULL_CODE for channel in range(3)]
    squares = [np.square(2 * value - 1) for value in values]
    total = squares[0] + squares[1] + squares[2]
    shares = [_off(total, tolerance)]
    for value, square in zip(values, squares, strict=True):
        others = total - square
        shares.append(_off(others + np.where(value > 0, np.square(value), (1 - others).clip(0)), tolerance))
    return tuple(shares)


def ranked(angles: Sequence[Float[np.ndarray, " c"]]) -> Mapping[Convention, float]:
    """Conventions by the median of their angles over frames, the best first."""
    medians = np.median(np.stack(list(angles)), axis=0)
    return {CONVENTIONS[index]: float(medians[index]) for index in np.argsort(medians, kind="stable")}


def _off(squared: np.ndarray, tolerance: float) -> float:
    return float(np.mean(np.abs(np.sqrt(squared) - 1) > tolerance))


def _blocks(values: np.ndarray, camera: Camera) -> np.ndarray:
    """Means over blocks of pixels; pixels left over at the right and the bottom are cut off."""
    block, block_camera = in_blocks(camera)
    rows, columns = block_camera.size_hw
    cut = np.ascontiguousarray(values[: rows * block, : columns * block], np.float32)
    return cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA)


def _normals(mm: np.ndarray, certain: np.ndarray, camera: Camera) -> np.ndarray:
    """Normals (h, w, 3) of depth (h, w)."""
    depth, mask = (torch.from_numpy(values)[None, None] for values in (mm, certain))
    return normals_from_depth(depth, camera.rays(), mask)[0].permute(1, 2, 0).numpy()


def _medians(stored: np.ndarray, derived: np.ndarray) -> np.ndarray:
    """Median angles through one camera: the median of cosines is the cosine of the median."""
    cosines = []
    for clipped in ENCODINGS:
        vectors = _decoded(stored, clipped)
        parts = vectors[:, :, None] * derived[:, None, :]
        for order in _orders(clipped):
            along = np.stack([parts[:, channel, axis] for axis, channel in enumerate(order)])
            cosines.append(np.median(SIGNS @ along, axis=1))
    return np.degrees(np.arccos(np.concatenate(cosines).clip(-1, 1)))


def _decoded(stored: np.ndarray, clipped: int | None) -> np.ndarray:
    """Unit vectors (n, 3) in the order of the channels; a cut-off z follows from the unit length."""
    vectors = 2 * stored - 1
    if clipped is not None:
        z, others = stored[:, clipped], np.delete(vectors, clipped, axis=1)
        lost = -np.sqrt(np.maximum(0, 1 - np.square(others).sum(axis=1)))
        vectors[:, clipped] = np.where(z > 0, z, lost)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-6)

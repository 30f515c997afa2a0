"""Truth with holes under random transforms, pixel by pixel against the rule written out in loops."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from col3d.data.resize import WHOLE
from col3d.data.transforms import crop, flip, rotate
from col3d.geometry import PinholeCamera

HEIGHT, WIDTH = 20, 27
FOCAL, CENTRE = (30.0, 20.0), (13.0, 10.0)
Source = Callable[[int, int], tuple[float, float]]
"""Where in the frame before (x, y) a pixel (u, v) is taken from."""


def batch(share: float) -> Any:
    """Depth known at a share of pixels, normals at most of those."""
    draw, shape = np.random.default_rng(1), (1, 1, HEIGHT, WIDTH)
    known = draw.random(shape) < share
    depth = np.where(known, draw.uniform(5, 60, shape), 0.0)
    normals = draw.normal(size=(1, 3, HEIGHT, WIDTH))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= known & (draw.random(shape) < 0.7)
    return {
        "image": torch.from_numpy(draw.random((1, 3, HEIGHT, WIDTH))).float(),
        "depth": torch.from_numpy(depth).float(),
        "mask": torch.from_numpy(known),
        "normals": torch.from_numpy(normals).float(),
        "rays": PinholeCamera.from_focal((HEIGHT, WIDTH), *FOCAL, *CENTRE).rays()[None],
        "video": ["v"],
        "frame": torch.zeros(1, dtype=torch.long),
    }


def by_the_rule(before: Any, source: Source, turn: np.ndarray, sparse: bool) -> tuple[np.ndarray, ...]:
    """Depth (h, w), mask (h, w), normals (3, h, w), and which pixels rounding does not decide."""
    depth, mask, normals = (before[key][0].double().numpy() for key in ("depth", "mask", "normals"))
    found, counts = np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), bool)
    vectors, clear = np.zeros((3, HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), bool)
    for v in range(HEIGHT):
        for u in range(WIDTH):
            x, y = source(u, v)
            left, top = math.floor(x), math.floor(y)
            across, down = x - left, y - top
            clear[v, u] = all(min(part, 1 - part, abs(part - 0.5)) > 1e-3 for part in (across, down))
            cells = [
                (top + i, left + j, (down if i else 1 - down) * (across if j else 1 - across))
                for i in (0, 1)
                for j in (0, 1)
            ]
            known = sum(share for row, column, share in cells if is_known(mask[0], row, column))
            clear[v, u] &= abs(known - WHOLE) > 5e-4
            if known > WHOLE:
                inside = [
                    (np.clip(row, 0, HEIGHT - 1), np.clip(column, 0, WIDTH - 1), k)
                    for row, column, k in cells
                ]
                counts[v, u] = True
                found[v, u] = sum(share * depth[0, row, column] for row, column, share in inside)
                mean = turn @ sum(share * normals[:, row, column] for row, column, share in inside)
                vectors[:, v, u] = mean / max(np.linalg.norm(mean), 1e-9)
            elif sparse and is_known(mask[0], round(y), round(x)):
                counts[v, u] = True
                found[v, u] = depth[0, round(y), round(x)]
                vectors[:, v, u] = turn @ normals[:, round(y), round(x)]
    return found, counts, vectors, clear


def is_known(mask: np.ndarray, row: int, column: int) -> bool:
    return 0 <= row < HEIGHT and 0 <= column < WIDTH and bool(mask[row, column])


def follow_the_rule(before: Any, after: Any, source: Source, turn: np.ndarray, sparse: bool) -> None:
    depth, mask, normals, clear = by_the_rule(before, source, turn, sparse)
    assert clear.mean() > 0.5
    np.testing.assert_array_equal(after["mask"][0, 0].numpy()[clear], mask[clear])
    np.testing.assert_allclose(after["depth"][0, 0].numpy()[clear], depth[clear], atol=1e-3)
    np.testing.assert_allclose(after["normals"][0].numpy()[:, clear], normals[:, clear], atol=1e-3)


holes = pytest.mark.parametrize("share", [0.3, 0.9, 1.0])
either = pytest.mark.parametrize("sparse", [False, True])


@holes
@either
@pytest.mark.parametrize("degrees", [0.7, -12.0, 33.0, -77.0])
def test_a_turn(share: float, sparse: bool, degrees: float) -> None:
    before = batch(share)
    after = rotate(before, torch.tensor([degrees]), sparse)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    width, height = (1 / math.sqrt(focal**2 + 1) for focal in FOCAL)  # of a pixel, on the unit sphere
    aspect, middle = width / height, np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    back = np.linalg.inv([[cos, -sin / aspect], [sin * aspect, cos]])

    def source(u: int, v: int) -> tuple[float, float]:
        x, y = back @ (np.array([u, v]) - middle) + middle
        return float(x), float(y)

    follow_the_rule(before, after, source, np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]), sparse)


@holes
@either
@pytest.mark.parametrize(("kept", "place"), [(0.7, (0.2, 0.9)), (0.31, (0.1, 0.87)), (0.9, (0.45, 0.55))])
def test_a_window(share: float, sparse: bool, kept: float, place: tuple[float, float]) -> None:
    before = batch(share)
    after = crop(before, kept, torch.tensor([place]), sparse)
    top, left = place[0] * (1 - kept) * HEIGHT, place[1] * (1 - kept) * WIDTH

    def source(u: int, v: int) -> tuple[float, float]:
        return (u + 0.5) * kept + left - 0.5, (v + 0.5) * kept + top - 0.5

    follow_the_rule(before, after, source, np.eye(3), sparse)


@holes
def test_a_mirror(share: float) -> None:
    before = batch(share)
    after = flip(before, torch.tensor([True]))
    for key, sign in (("depth", 1), ("mask", 1), ("normals", np.array([-1, 1, 1])[:, None, None])):
        expected = before[key][0].numpy()[..., ::-1] * sign
        np.testing.assert_array_equal(after[key][0].numpy(), expected)

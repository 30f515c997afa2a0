"""Flicker is nothing for what stands still or grows steadily, and a number in percent for what jumps."""

import math

import pytest
import torch

from col3d.metrics.functional.flicker import temporal_flicker


def test_still_and_steady_depth_does_not_flicker() -> None:
    depth = torch.rand(2, 1, 8, 10, generator=torch.Generator().manual_seed(0)) * 50 + 5
    assert temporal_flicker(depth, depth, depth).abs().max() < 1e-5
    assert temporal_flicker(depth, depth * 1.1, depth * 1.21).abs().max() < 1e-3
    assert torch.allclose(
        temporal_flicker(depth, depth * 1.1, depth), temporal_flicker(depth * 7, depth * 7.7, depth * 7)
    )


def test_a_jump_of_a_tenth_is_ten_percent_in_logarithms() -> None:
    depth = torch.full((1, 1, 4, 4), 20.0)
    assert temporal_flicker(depth, depth * 1.1, depth).item() == pytest.approx(100 * math.log(1.1), rel=1e-4)


def test_masked_pixels_are_inert_and_none_gives_nan() -> None:
    depth, mask = torch.full((1, 1, 4, 4), 20.0), torch.zeros(1, 1, 4, 4, dtype=torch.bool)
    assert temporal_flicker(depth, depth, depth, mask).isnan().all()
    mask[..., :2] = True
    jumping = torch.where(mask, depth, depth * 3)
    assert temporal_flicker(depth, jumping, depth, mask).item() == 0

"""Boundary F1: a twin in numpy, and laws."""

import numpy as np
import pytest
import torch
from torch import Tensor

from col3d.metrics.functional import boundary_f1

GENERATOR = torch.Generator().manual_seed(0)
TARGET = 20 * (0.15 * torch.randn(3, 1, 15, 19, generator=GENERATOR)).exp()
PREDS = TARGET * (0.08 * torch.randn(3, 1, 15, 19, generator=GENERATOR)).exp()
MASK = torch.rand(3, 1, 15, 19, generator=GENERATOR) > 0.1


def twin(preds: np.ndarray, target: np.ndarray, mask: np.ndarray) -> float:
    """Depth Pro, section 3.4, pixel by pixel."""
    height, width = target.shape
    total = weights = 0.0
    for t in np.linspace(1.05, 1.25, 10):
        recalls, precisions = [], []
        for down, right in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            found = there = both = 0
            for i in range(height):
                for j in range(width):
                    k, m = i + down, j + right
                    if not (0 <= k < height and 0 <= m < width and mask[i, j] and mask[k, m]):
                        continue
                    p, q = preds[i, j] / preds[k, m] > t, target[i, j] / target[k, m] > t
                    found, there, both = found + p, there + q, both + (p and q)
            recalls.append(both / max(there, 1))
            precisions.append(both / max(found, 1))
        r, p = np.mean(recalls), np.mean(precisions)
        total += t * (2 * p * r / (p + r) if p + r > 0 else 0.0)
        weights += t
    return float(total / weights)


def test_equals_its_twin() -> None:
    found = boundary_f1(PREDS, TARGET, MASK)
    assert found.shape == (3,)
    for i in range(3):
        maps = (x[i, 0].double().numpy() for x in (PREDS, TARGET))
        assert found[i].item() == pytest.approx(twin(*maps, MASK[i, 0].numpy()), rel=1e-12)
    assert (found > 0.3).all()


def test_perfect_where_there_are_edges_and_zero_where_there_are_none() -> None:
    assert boundary_f1(TARGET, TARGET, MASK).tolist() == [1.0, 1.0, 1.0]
    assert boundary_f1(PREDS, torch.full_like(TARGET, 9.0), MASK).tolist() == [0.0, 0.0, 0.0]
    assert boundary_f1(torch.full_like(TARGET, 9.0), TARGET, MASK).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_scale_does_not_matter(factor: float) -> None:
    """Powers of two, which change no ratio in floating point."""
    assert torch.equal(boundary_f1(factor * PREDS, TARGET, MASK), boundary_f1(PREDS, TARGET, MASK))


def flipped(dim: int) -> tuple[Tensor, ...]:
    return tuple(x.flip(dim) for x in (PREDS, TARGET, MASK))


def test_inverse_depth_mirrors_and_turned_frames_score_the_same() -> None:
    plain = boundary_f1(PREDS, TARGET, MASK)
    inverse = boundary_f1(PREDS.double().reciprocal(), TARGET.double().reciprocal(), MASK)
    torch.testing.assert_close(inverse, plain, rtol=1e-12, atol=0)
    for maps in (flipped(-1), flipped(-2), tuple(x.mT for x in (PREDS, TARGET, MASK))):
        torch.testing.assert_close(boundary_f1(*maps), plain, rtol=1e-12, atol=0)


def test_prediction_and_truth_may_change_places() -> None:
    torch.testing.assert_close(
        boundary_f1(TARGET, PREDS, MASK), boundary_f1(PREDS, TARGET, MASK), rtol=1e-12, atol=0
    )


def test_masked_pixels_do_not_count_and_an_empty_frame_has_none() -> None:
    mask = MASK.clone()
    mask[1] = False
    expected = boundary_f1(PREDS, TARGET, mask)
    assert expected.isnan().tolist() == [False, True, False]
    spoilt = (torch.where(mask, x, torch.nan) for x in (PREDS, TARGET))
    torch.testing.assert_close(boundary_f1(*spoilt, mask), expected, equal_nan=True)


def test_erosion_leaves_out_the_neighbours_of_what_does_not_count() -> None:
    mask = torch.ones_like(MASK)
    mask[..., 7, 9] = False
    smaller = mask.clone()
    smaller[..., 5:10, 7:12] = False
    expected = boundary_f1(PREDS, TARGET, smaller)
    assert torch.equal(boundary_f1(PREDS, TARGET, mask, erosion=2), expected)
    assert not torch.equal(boundary_f1(PREDS, TARGET, mask), expected)

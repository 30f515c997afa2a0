"""Windows against explicit loops over their pixels; what a shift and filling up must not do."""

from itertools import product

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from col3d.layers.window_attention import WindowAttention, WindowBlock, from_windows, to_windows


def attention(shift: int, own_value: bool, channels: int = 4) -> WindowAttention:
    torch.manual_seed(0)
    made = WindowAttention(channels, heads=2, shift=shift, own_value=own_value).double()
    nn.init.normal_(made.relative_position_bias_table)
    return made


def reference(made: WindowAttention, x: Tensor, value: Tensor | None) -> np.ndarray:
    """Each pixel looks at its own cell of a grid that is moved by the shift: nothing is rolled or masked."""
    weight = {name: parameter.detach().numpy() for name, parameter in made.named_parameters()}
    heads, c, (height, width) = made.heads, made.channels, x.shape[1:3]
    filled = [
        np.pad(part[0].numpy(), ((0, -height % 7), (0, -width % 7), (0, 0)))
        for part in (x, value)
        if part is not None
    ]
    projected = filled[0] @ weight["qkv.weight"].T + weight["qkv.bias"]
    q, k = projected[..., :c], projected[..., c : 2 * c]
    v = projected[..., 2 * c :] if value is None else filled[1]
    out, d = np.empty((height, width, c)), c // heads
    pixels = list(product(range(q.shape[0]), range(q.shape[1])))
    for row, column, head in product(range(height), range(width), range(heads)):
        cell = ((row - made.shift) // 7, (column - made.shift) // 7)
        seen = [(i, j) for i, j in pixels if ((i - made.shift) // 7, (j - made.shift) // 7) == cell]
        part = slice(head * d, (head + 1) * d)
        scores = [
            q[row, column, part] @ k[i, j, part] / np.sqrt(d)
            + weight["relative_position_bias_table"][(row - i + 6) * 13 + column - j + 6, head]
            for i, j in seen
        ]
        share = np.exp(scores) / np.exp(scores).sum()
        out[row, column, part] = sum(s * v[i, j, part] for s, (i, j) in zip(share, seen, strict=True))
    return out @ weight["proj.weight"].T + weight["proj.bias"]


@pytest.mark.parametrize("own_value", [True, False])
@pytest.mark.parametrize("shift", [0, 3])
@pytest.mark.parametrize("size_hw", [(14, 7), (5, 9)])
def test_loops_over_pixels(size_hw: tuple[int, int], shift: int, own_value: bool) -> None:
    made, x = attention(shift, own_value), torch.randn(1, *size_hw, 4).double()
    value = None if own_value else torch.randn_like(x)
    expected = torch.from_numpy(reference(made, x, value))
    torch.testing.assert_close(made(x, value)[0], expected, atol=1e-12, rtol=0)


def test_windows_are_blocks_of_the_map_and_join_again() -> None:
    x = torch.randn(2, 6, 9, 4)
    windows = to_windows(x, 3)
    assert torch.equal(windows[:, 4], x[:, 3:6, 3:6].flatten(1, 2))
    assert torch.equal(from_windows(windows, (6, 9)), x)


@pytest.mark.parametrize("shift", [0, 3])
def test_filled_up_by_hand_changes_nothing(shift: int) -> None:
    made, x, value = (
        attention(shift, own_value=False),
        torch.randn(2, 9, 12, 4).double(),
        torch.randn(2, 9, 12, 4),
    )
    value = value.double()
    whole = made(*(nn.functional.pad(part, (0, 0, 0, 2, 0, 5)) for part in (x, value)))
    assert torch.equal(made(x, value), whole[:, :9, :12])


def test_pixels_that_the_shift_brings_together_do_not_see_one_another() -> None:
    made, x = attention(shift=3, own_value=True), torch.randn(1, 14, 14, 4).double()
    changed = x.clone()
    changed[:, :3, :3] += 1
    same = (made(x) == made(changed)).all(dim=-1)[0]
    assert not same[:3, :3].any()
    assert same[3:].all()
    assert same[:, 3:].all()


def test_windows_move_with_the_map() -> None:
    made, x = attention(shift=0, own_value=True), torch.randn(1, 14, 21, 4).double()
    torch.testing.assert_close(made(x.roll((7, 7), (1, 2))), made(x).roll((7, 7), (1, 2)))


def test_constant_values_stay() -> None:
    made, x = attention(shift=3, own_value=False), torch.randn(1, 14, 14, 4).double()
    value = torch.randn(4).double().expand_as(x)
    torch.testing.assert_close(made(x, value), made.proj(value))


def test_scores_beyond_half_precision_stay_finite() -> None:
    made, x = attention(shift=3, own_value=True).float(), 1e3 * torch.randn(1, 8, 8, 4)
    with torch.autocast("cpu", torch.bfloat16):
        assert made(x).isfinite().all()


def test_block_is_its_input_when_its_residuals_are_dropped() -> None:
    block, x = WindowBlock(8, heads=2, shift=3, drop_path=0.5).train(), torch.randn(64, 7, 7, 8)
    torch.manual_seed(0)
    kept = (block(x) != x).flatten(1).any(dim=1)
    assert 32 < kept.sum() < 64
    assert (block.eval()(x) != x).flatten(1).any(dim=1).all()

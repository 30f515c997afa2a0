"""Attention inside windows of 7 x 7 pixels, for Swin and for neural CRFs."""

from math import isqrt

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from col3d.geometry.precision import at_least_float32

WINDOW = 7


def whole_windows(length: int) -> int:
    """The least multiple of `WINDOW` that is not below a length.

    >>> [whole_windows(length) for length in (7, 8)]
    [7, 14]
    """
    return (length + WINDOW - 1) // WINDOW * WINDOW


def to_windows(x: Float[Tensor, "b h w c"], side: int) -> Float[Tensor, "b n pixels c"]:
    """Cut a map whose sides are multiples of `side` into windows; windows and their pixels run row by row."""
    b, height, width, c = x.shape
    rows_and_columns = x.reshape(b, height // side, side, width // side, side, c)
    return rows_and_columns.transpose(2, 3).reshape(b, -1, side * side, c)


def from_windows(
    windows: Float[Tensor, "b n pixels c"], size_hw: tuple[int, int]
) -> Float[Tensor, "b h w c"]:
    """Join windows of `to_windows` into the map of this size."""
    b, _, pixels, c = windows.shape
    side, (height, width) = isqrt(pixels), size_hw
    grid = windows.reshape(b, height // side, width // side, side, side, c)
    return grid.transpose(2, 3).reshape(b, height, width, c)


def relative_position(side: int) -> Int[Tensor, "pixels pixels"]:
    """Index of the offset of pixel i from pixel j of a window in a table of all (2 side - 1)^2."""
    row, column = (index.flatten() for index in torch.meshgrid(*2 * [torch.arange(side)], indexing="ij"))
    down, right = row[:, None] - row, column[:, None] - column
    return (down + side - 1) * (2 * side - 1) + right + side - 1


def neighbours(
    size_hw: tuple[int, int], side: int, shift: int, device: torch.device | None = None
) -> Bool[Tensor, "n pixels pixels"]:
    """Pairs of pixels of a window that were neighbours before the map was rolled up and left by `shift`.

    The roll moves the first rows after the last ones and the first columns after the last ones: they share a
    window, but must not attend to one another.
    """
    rows, columns = (torch.arange(length, device=device) >= length - shift for length in size_hw)
    part = (2.0 * rows[:, None] + columns)[None, :, :, None]
    pixel_part = to_windows(part, side)[0, :, :, 0]
    return pixel_part[:, :, None] == pixel_part[:, None, :]


class WindowAttention(nn.Module):
    """softmax(q k^T / sqrt(d) + bias) v inside each window, where the bias depends on the pixels' offset.

    The map is padded with zeros to whole windows, then rolled by the shift. Padded pixels are not masked, as
    in the published weights' training.

    Args:
        channels: channels of the map.
        heads: number of attention heads, a divisor of the channels.
        shift: offset of the windows to the lower right of the plain grid, in pixels.
        own_value: whether values are a linear map of x, too; otherwise they are given to `forward`.

    References:
        Liu et al., Swin Transformer, ICCV 2021, equation 4.
        Yuan et al., Neural Window Fully-connected CRFs for Monocular Depth Estimation, CVPR 2022, section 3.
    """

    offsets: Tensor

    def __init__(self, channels: int, heads: int, shift: int = 0, own_value: bool = True) -> None:
        super().__init__()
        self.channels, self.heads, self.shift, self.own_value = channels, heads, shift, own_value
        self.qkv = nn.Linear(channels, (3 if own_value else 2) * channels)
        self.proj = nn.Linear(channels, channels)
        self.relative_position_bias_table = nn.Parameter(torch.empty((2 * WINDOW - 1) ** 2, heads))
        nn.init.trunc_normal_(self.relative_position_bias_table, std=0.02)
        self.register_buffer("offsets", relative_position(WINDOW), persistent=False)

    def forward(
        self, x: Float[Tensor, "b h w c"], value: Float[Tensor, "b h w c"] | None = None
    ) -> Float[Tensor, "b h w c"]:
        """A map, and the values if they do not come from it -> the attended values."""
        assert (value is None) == self.own_value
        _, height, width, _ = x.shape
        full_hw = (whole_windows(height), whole_windows(width))
        q, k, *own = self.qkv(self._cut(x)).split(self.channels, dim=-1)
        v = own[0] if value is None else self._cut(value)
        weights = self._weights(self._to_heads(q), self._to_heads(k), full_hw)
        attended = weights.to(v.dtype) @ self._to_heads(v)
        whole = from_windows(self.proj(attended.transpose(2, 3).flatten(3)), full_hw)
        return whole.roll((self.shift, self.shift), dims=(1, 2))[:, :height, :width]

    def _cut(self, x: Float[Tensor, "b h w c"]) -> Float[Tensor, "b n pixels c"]:
        _, height, width, _ = x.shape
        x = nn.functional.pad(x, (0, 0, 0, whole_windows(width) - width, 0, whole_windows(height) - height))
        return to_windows(x.roll((-self.shift, -self.shift), dims=(1, 2)), WINDOW)

    def _to_heads(self, x: Float[Tensor, "b n pixels c"]) -> Float[Tensor, "b n heads pixels d"]:
        return x.unflatten(-1, (self.heads, -1)).transpose(2, 3)

    def _weights(
        self,
        q: Float[Tensor, "b n heads pixels d"],
        k: Float[Tensor, "b n heads pixels d"],
        full_hw: tuple[int, int],
    ) -> Float[Tensor, "b n heads pixels pixels"]:
        bias = self.relative_position_bias_table[self.offsets].permute(2, 0, 1)
        scores = at_least_float32(q * q.shape[-1] ** -0.5 @ k.transpose(-1, -2)) + bias
        if self.shift:
            together = neighbours(full_hw, WINDOW, self.shift, q.device)
            scores = scores.masked_fill(~together[:, None], -torch.inf)
        return scores.softmax(dim=-1)


class WindowBlock(nn.Module):
    """x + attention(norm(x)), then x + mlp(norm(x)); the hidden layer of the mlp is 4 times as wide.

    Args:
        channels: channels of the map.
        heads: see `WindowAttention`, as for `shift` and `own_value`.
        shift: shift of the windows, in pixels.
        drop_path: probability of dropping a residual in training, in [0, 1).
        own_value: whether values are a linear map of x.
    """

    def __init__(
        self, channels: int, heads: int, shift: int, drop_path: float = 0.0, own_value: bool = True
    ) -> None:
        from timm.layers import DropPath, Mlp

        super().__init__()
        self.norm1 = nn.LayerNorm(channels)
        self.attn = WindowAttention(channels, heads, shift, own_value)
        self.drop_path = DropPath(drop_path)
        self.norm2 = nn.LayerNorm(channels)
        self.mlp = Mlp(channels, 4 * channels)

    def forward(
        self, x: Float[Tensor, "b h w c"], value: Float[Tensor, "b h w c"] | None = None
    ) -> Float[Tensor, "b h w c"]:
        """A map, and the values if they do not come from it -> the refined map."""
        x = x + self.drop_path(self.attn(self.norm1(x), value))
        refined: Tensor = x + self.drop_path(self.mlp(self.norm2(x)))
        return refined

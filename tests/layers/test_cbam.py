"""Attention against a twin in numpy, and where its answer is known."""

import numpy as np
import torch
from torch import nn

from col3d.layers.cbam import CBAM, ChannelAttention, SpatialAttention


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-x))


def correlate(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, kernel.shape[0] // 2), kernel.shape)
    return (windows * kernel).sum(axis=(2, 3))


def twin(x: np.ndarray, squeeze: np.ndarray, expand: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """One frame of CBAM in float64: `x` is (c, h, w)."""
    logit = sum(expand @ np.maximum(squeeze @ pooled, 0) for pooled in (x.mean((1, 2)), x.max((1, 2))))
    x = x * sigmoid(logit)[:, None, None]
    pair = np.stack([x.mean(0), x.max(0)])
    return x * sigmoid(sum(correlate(m, k) for m, k in zip(pair, kernel, strict=True)))


def test_cbam_equals_its_twin() -> None:
    block, x = CBAM(32), torch.randn(2, 32, 5, 9)
    squeeze, expand = (block.channel.mlp[i].weight[:, :, 0, 0].detach().double().numpy() for i in (0, 2))
    kernel = block.spatial.conv.weight[0].detach().double().numpy()
    expected = [twin(frame.double().numpy(), squeeze, expand, kernel) for frame in x]
    np.testing.assert_allclose(block(x).detach().numpy(), np.stack(expected), atol=1e-5)


def test_zero_weights_leave_a_quarter() -> None:
    block, x = CBAM(16), torch.randn(1, 16, 4, 4)
    for weight in block.parameters():
        nn.init.zeros_(weight)
    assert torch.allclose(block(x), x / 4)


def test_channels_permute_with_their_weights() -> None:
    block, x, order = SpatialAttention(), torch.randn(1, 6, 4, 4), torch.randperm(6)
    assert torch.allclose(block(x), block(x[:, order]), atol=1e-6)


def test_hidden_layer_is_sixteen_times_smaller_but_never_empty() -> None:
    assert [ChannelAttention(c).mlp[0].out_channels for c in (256, 64, 8)] == [16, 4, 1]


def test_channel_attention_ignores_where() -> None:
    block, x = ChannelAttention(16), torch.randn(1, 16, 4, 4)
    assert torch.allclose(block(x), block(x.flip(-1)), atol=1e-6)

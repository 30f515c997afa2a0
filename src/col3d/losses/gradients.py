"""Gradient losses of depth: difference of slopes, and cosine between the patterns of slopes.

Slopes are Sobel derivatives by the kernel [1 2 1]^T [-1 0 1] and its transpose, not divided by their weight:
a depth that grows by s mm a pixel has the derivative 8 s. Where a pixel of the 3 x 3 is masked or outside the
image there is no slope. (The published code pads with zeros and masks nothing.)
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from col3d.batch import check_maps
from col3d.geometry.precision import at_least_float32
from col3d.losses.masked import masked_mean


def gradient_l1(
    preds: Float[Tensor, "b 1 h w"], target: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """Mean absolute difference of the Sobel derivatives, in mm by the undivided kernels.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel is known; the mean is over both derivatives of the batch's pixels whose eight
            neighbours are known too.

    Returns:
        A scalar; zero where no pixel has a slope.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        Hu et al.: Revisiting Single Image Depth Estimation, WACV 2019, eq. 4 (there of the logarithm);
        the gradient loss of the public MonoDepth-FPN.
    """
    check_maps(preds, target, mask)
    gap = torch.where(mask, at_least_float32(preds) - at_least_float32(target), 0.0)
    return masked_mean(sobel(gap).abs(), with_neighbours(mask))


def gradient_direction(
    preds: Float[Tensor, "b 1 h w"], target: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b 1 h w"]
) -> Float[Tensor, ""]:
    """1 - cosine between the two maps' derivatives: the "normal" loss of MonoDepth-FPN.

    All of a frame's d/dx make one long vector, all of its d/dy another; so this compares the patterns of
    slopes and no normals of single pixels. Neither a factor on the depth nor an offset changes it.

    Args:
        preds: predicted depth in mm.
        target: true depth in mm; anything where masked.
        mask: True where a pixel is known; only those enter whose eight neighbours are known too.

    Returns:
        A scalar in [0, 2], the mean over both derivatives of the frames that have such pixels. A derivative
        that is zero everywhere costs 0 where the other map's is zero, too, else 1, without gradient.

    Raises:
        ValueError: the shapes do not belong together.

    References:
        The public MonoDepth-FPN; after Hu et al.: Revisiting Single Image Depth Estimation, WACV 2019, eq. 5,
        which takes the cosine at each pixel.
    """
    check_maps(preds, target, mask)
    counts = with_neighbours(mask)
    predicted, true = (_slope_directions(depth, mask, counts) for depth in (preds, target))
    one_is_flat = (predicted != 0).any(dim=-1) != (true != 0).any(dim=-1)
    # Half the squared distance of unit vectors is 1 - cosine, and exactly zero at the truth.
    cost = torch.where(one_is_flat, 1.0, (predicted - true).square().sum(dim=-1) / 2)
    return masked_mean(cost[..., None, None], counts.any(dim=(1, 2, 3), keepdim=True))


def sobel(depth: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b 2 _ _"]:
    """d/dx and d/dy of the pixels that have eight neighbours; exactly zero where depth is constant."""
    across, down = depth[..., 2:] - depth[..., :-2], depth[..., 2:, :] - depth[..., :-2, :]
    dx = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    dy = down[..., :-2] + 2 * down[..., 1:-1] + down[..., 2:]
    return torch.cat([dx, dy], dim=1)


def with_neighbours(mask: Bool[Tensor, "b 1 h w"]) -> Bool[Tensor, "b 1 _ _"]:
    """The pixels, of those that have eight neighbours, that are True with all of them."""
    rows = mask[..., :-2, :] & mask[..., 1:-1, :] & mask[..., 2:, :]
    return rows[..., :-2] & rows[..., 1:-1] & rows[..., 2:]


def _slope_directions(depth: Tensor, mask: Tensor, counts: Tensor) -> Float[Tensor, "b 2 n"]:
    slopes = sobel(torch.where(mask, at_least_float32(depth), 0.0))
    vectors = torch.where(counts, slopes, 0.0).flatten(2)
    square = vectors.square().sum(dim=-1, keepdim=True)
    return vectors / torch.where(square == 0, 1.0, square).sqrt()

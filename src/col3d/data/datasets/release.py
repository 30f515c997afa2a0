"""The two releases of C3VD: how each stores normals and poses, and which one a frame follows."""

from collections.abc import Mapping

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt16
from torch import Tensor
from torch.nn.functional import avg_pool2d

from col3d.geometry import Camera, angle_between, normals_from_depth, unit
from col3d.geometry.normals import unit_in_place

RELEASES = ("current", "pre_2023_05")
FULL_CODE = 65535
OFF_ORTHONORMAL = 1e-3
"""Largest difference of R R^T from 1 in a pose; C3VD's own are off by 2e-6."""
BLOCKS = 108
"""Rows of blocks in which stored normals are compared with the depth: wide enough for depth of 8 bits."""
AGREEMENT = 25.0
"""Median angle in degrees beyond which stored normals do not belong to the depth."""


def standard_normals(codes: np.ndarray, release: str) -> Float[Tensor, "3 h w"]:
    """Unit normals in standard axes from 16-bit codes (h, w, 3); the zero vector where none is stored.

    The current release stores (n + 1) / 2 in axes x right, y down, z into the scene. The one before May 2023
    stores x and y (up) in the same way and z (out of the scene) in 0..1 with negative values clipped to 0;
    what was clipped follows from the unit length of the normal.
    """
    channels = cv2.split(np.ascontiguousarray(codes))  # a plane at a time is several times as fast
    known = torch.from_numpy(stored_somewhere(*channels))
    stored = torch.empty(3, *known.shape)
    for plane, channel in zip(stored.numpy(), channels, strict=True):
        plane[...] = channel
    if release == "current":
        return unit_in_place(stored.mul_(2 / FULL_CODE).sub_(1).mul_(known))
    x, up, z = stored.div_(FULL_CODE).unbind()
    x.mul_(2).sub_(1)
    up.mul_(-2).add_(1)
    clipped_z = (1 - x.square() - up.square()).clamp_min(0).sqrt()
    z.copy_(torch.where(z > 0, -z, clipped_z))
    return unit_in_place(stored.mul_(known))


def stored_somewhere(
    red: UInt16[np.ndarray, "h w"], green: UInt16[np.ndarray, "h w"], blue: UInt16[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels at which a normal is stored: not all of its three codes are 0."""
    stored: np.ndarray = (red | green | blue) > 0  # ten times as fast as `any` over an axis of three
    return stored


def in_blocks(camera: Camera) -> tuple[int, Camera]:
    """Side of the blocks of pixels over which normals and depth are averaged, and the camera of their means.

    Pixels left over at the right and the bottom are cut off.
    """
    block = max(1, camera.size_hw[0] // BLOCKS)
    rows, columns = (side // block for side in camera.size_hw)
    return block, camera.cropped(0, 0, rows * block, columns * block).resized((rows, columns))


def disagreement(
    codes: np.ndarray, depth: Float[Tensor, "1 h w"], mask: Bool[Tensor, "1 h w"], camera: Camera
) -> Mapping[str, float]:
    """Median angle in degrees between stored normals and those of the depth, under each release's convention.

    Both are averaged over blocks first, for there are frames whose depth has steps of 0.4 mm.
    """
    block, block_camera = in_blocks(camera)
    whole = avg_pool2d(mask[None].float(), block) == 1
    derived = normals_from_depth(avg_pool2d(depth[None], block), block_camera.rays(), whole)
    medians = {}
    for release in RELEASES:
        stored = unit(avg_pool2d(standard_normals(codes, release)[None], block))
        angles = angle_between(stored, derived)[whole & (derived != 0).any(dim=1, keepdim=True)]
        medians[release] = angles.median().item() if angles.numel() else float("nan")
    return medians


def camera_to_world(rows: Float[np.ndarray, "n 16"]) -> Float[np.ndarray, "n 4 4"]:
    """Poses as matrices that act on column vectors: p_world = T @ [p, 1], in mm.

    The current release writes the transpose of that (its translation stands in the last row), the one before
    May 2023 the matrix itself; the place of (0, 0, 0, 1) tells.

    Raises:
        ValueError: neither the last row nor the last column of every matrix is (0, 0, 0, 1).
    """
    matrices = rows.reshape(-1, 4, 4)
    last = np.array([0.0, 0.0, 0.0, 1.0])
    if np.allclose(matrices[:, :, 3], last, atol=1e-6):
        return matrices.transpose(0, 2, 1).copy()
    if np.allclose(matrices[:, 3, :], last, atol=1e-6):
        return matrices
    raise ValueError("neither the last row nor the last column of the poses is (0, 0, 0, 1)")

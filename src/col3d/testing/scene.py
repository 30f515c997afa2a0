"""A synthetic scene in closed form, for checks."""

import torch

from col3d.batch import Batch
from col3d.geometry import Camera, OmnidirectionalCamera

Size = tuple[int, int]


def scene(size_hw: Size = (64, 80), frames: int = 2, camera: Camera | None = None) -> Batch:
    """A batch of slanted walls in closed form: depth in mm, and the exact normals of it.

    A corner of each mask is False, where depth is 0.

    Args:
        size_hw: height and width.
        frames: number of frames, each a wall at another distance.
        camera: camera of the rays; C3VD's lens when absent.
    """
    rays = (camera or OmnidirectionalCamera.c3vd()).resized(size_hw).rays()
    normal = torch.tensor([0.2, -0.1, -1.0])
    normal = normal / normal.norm()
    along = (normal[:, None, None] * rays).sum(dim=0)
    distance = torch.stack([-(30.0 + 10 * i) / along for i in range(frames)])
    depth = (distance * rays[2])[:, None]
    mask = ((along < -0.1) & (rays[2] > 0.1))[None, None].expand_as(depth) & (depth > 1) & (depth < 100)
    mask = mask.clone()
    mask[..., : size_hw[0] // 4, : size_hw[1] // 4] = False
    image = torch.rand(frames, 3, *size_hw, generator=torch.Generator().manual_seed(0))
    return {
        "image": image,
        "depth": torch.where(mask, depth, 0.0),
        "normals": normal[:, None, None].expand(frames, 3, *size_hw) * mask,
        "mask": mask,
        "rays": rays.expand(frames, -1, -1, -1),
        "video": ["wall"] * frames,
        "frame": torch.arange(frames),
    }

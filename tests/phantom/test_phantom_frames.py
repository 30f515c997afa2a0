"""What a frame of the phantom is: C3VD's formats, and modalities that agree with each other."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from col3d.data.datasets.octagon import octagon_mask
from col3d.geometry import angle_between, normals_from_depth, points_from_depth
from col3d.phantom import PhantomSettings, phantom_camera

FRAMES = range(8)


def read(path: Path) -> np.ndarray:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., ::-1])


def depth_of(video: Path, number: int) -> torch.Tensor:
    return torch.from_numpy(read(video / f"{number:04d}_depth.tiff").astype(np.float32))[None] / 65535 * 100


def normals_of(video: Path, number: int) -> torch.Tensor:
    codes = torch.from_numpy(read(video / f"{number:04d}_normals.tiff").astype(np.float32))
    return (codes / 65535 * 2 - 1).permute(2, 0, 1)


def poses_of(video: Path) -> torch.Tensor:
    """Rows as C3VD states them: p_world = [p, 1] @ M."""
    return torch.from_numpy(np.loadtxt(video / "pose.txt", delimiter=",").reshape(-1, 4, 4))


def mask_of(settings: PhantomSettings, depth: torch.Tensor) -> torch.Tensor:
    return octagon_mask(settings.size_hw) & (depth > 0) & (depth < 100)


def test_files_have_the_formats_of_the_current_release(video: Path, settings: PhantomSettings) -> None:
    kinds = {
        "color.png": np.uint8,
        "depth.tiff": np.uint16,
        "normals.tiff": np.uint16,
        "flow.tiff": np.uint16,
        "occlusion.png": np.uint8,
    }
    names = {f"{n:04d}_{kind}" for n in FRAMES for kind in kinds} - {"0000_flow.tiff"}
    names |= {"pose.txt", "coverage_mesh.obj", "phantom.json"}
    assert {path.name for path in video.iterdir()} == names
    for kind, dtype in kinds.items():
        pixels = read(video / f"0003_{kind}")
        assert pixels.dtype == dtype
        assert pixels.shape == (*settings.size_hw, 3)[: 2 if kind in ("depth.tiff", "occlusion.png") else 3]


def test_tiffs_are_not_compressed(video: Path, settings: PhantomSettings) -> None:
    with Image.open(video / "0000_depth.tiff") as depth:
        assert depth.tag_v2[259] == 1
    assert (video / "0000_normals.tiff").stat().st_size >= 6 * settings.size_hw[0] * settings.size_hw[1]


def test_the_octagon_is_full_and_its_outside_is_empty(video: Path, settings: PhantomSettings) -> None:
    inside = octagon_mask(settings.size_hw)[0].numpy()
    for number in FRAMES:
        depth, normals = read(video / f"{number:04d}_depth.tiff"), read(video / f"{number:04d}_normals.tiff")
        assert (depth[inside] > 0).all()
        assert (depth[~inside] == 0).all()
        assert (normals[~inside] == 0).all()
        assert (normals[inside] != 0).any(axis=-1).all()


def test_outside_the_octagon_colour_is_dark_but_not_pure_black(
    video: Path, settings: PhantomSettings
) -> None:
    outside = read(video / "0000_color.png")[~octagon_mask(settings.size_hw)[0].numpy()]
    assert 0 < outside.mean() < 10


def test_little_lies_beyond_100_mm(video: Path) -> None:
    clipped = [(read(video / f"{n:04d}_depth.tiff") == 65535).mean() for n in FRAMES]
    assert max(clipped) < 0.06


@pytest.mark.parametrize("number", FRAMES)
def test_normals_are_those_of_the_depth(video: Path, settings: PhantomSettings, number: int) -> None:
    depth, normals = depth_of(video, number), normals_of(video, number)
    mask = mask_of(settings, depth)
    derived = normals_from_depth(depth[None], phantom_camera(settings).rays(), mask[None])[0]
    assert angle_between(derived, normals)[mask].median() < 1.0


@pytest.mark.parametrize("number", FRAMES)
def test_normals_are_unit_and_face_the_camera(video: Path, settings: PhantomSettings, number: int) -> None:
    normals, inside = normals_of(video, number), octagon_mask(settings.size_hw)[0]
    along = (normals * phantom_camera(settings).rays()).sum(dim=0)
    assert (normals.norm(dim=0)[inside] - 1).abs().max() < 1e-4
    assert along[inside].max() < 0


def test_poses_are_rigid(video: Path) -> None:
    poses = poses_of(video)
    turn = poses[:, :3, :3]
    torch.testing.assert_close(
        turn @ turn.mT, torch.eye(3, dtype=torch.float64).expand_as(turn), atol=1e-7, rtol=0
    )
    assert (torch.linalg.det(turn) > 0).all()
    assert (poses[:, :3, 3] == 0).all()
    assert (poses[:, 3, 3] == 1).all()


def test_neighbouring_frames_see_the_same_wall(video: Path, settings: PhantomSettings) -> None:
    camera, poses = phantom_camera(settings), poses_of(video)
    for first, second in pairwise(FRAMES):
        depth, there = depth_of(video, first), depth_of(video, second)
        points = points_from_depth(depth[None], camera.rays())[0][:, mask_of(settings, depth)[0]].double()
        points = torch.cat([points, torch.ones_like(points[:1])]).T
        moved = (points @ poses[first] @ poses[second].inverse())[:, :3]
        u, v = camera.project(moved).T
        height, width = settings.size_hw
        grid = torch.stack([2 * u / (width - 1) - 1, 2 * v / (height - 1) - 1], dim=-1)[None, None]
        seen = torch.nn.functional.grid_sample(there[None].double(), grid, align_corners=True)[0, 0, 0]
        visible = (grid[0, 0].abs() < 1).all(dim=-1) & (seen > 0) & (seen < 99) & (moved[:, 2] < seen + 2)
        assert visible.float().mean() > 0.2
        assert (seen - moved[:, 2])[visible].abs().median() < 0.2


def ranks(values: np.ndarray) -> np.ndarray:
    return values.argsort(kind="stable").argsort(kind="stable").astype(float)


@pytest.mark.parametrize("number", FRAMES)
def test_brightness_falls_with_depth(video: Path, settings: PhantomSettings, number: int) -> None:
    inside = octagon_mask(settings.size_hw)[0].numpy()
    bright = read(video / f"{number:04d}_color.png").mean(axis=-1)[inside]
    depth = read(video / f"{number:04d}_depth.tiff")[inside]
    assert np.corrcoef(ranks(bright), ranks(depth))[0, 1] < -0.4


def test_colours_are_reddish_and_neither_dark_nor_burnt(video: Path, settings: PhantomSettings) -> None:
    inside = octagon_mask(settings.size_hw)[0].numpy()
    for number in FRAMES:
        color = read(video / f"{number:04d}_color.png")[inside]
        assert color[:, 0].mean() > 1.1 * color[:, 2].mean()
        assert 70 < color.mean() < 200
        assert (color.min(axis=-1) > 250).mean() < 0.15

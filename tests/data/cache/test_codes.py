"""QuantizedBatch: what they lose is what their page says, everywhere on the sphere and over all depths."""

from typing import Any

import pytest
import torch
from torch import Tensor

from col3d.batch import Batch
from col3d.data.cache.codes import WORST_ANGLE, decode, encode, from_octahedral, octahedral
from col3d.data.resize import Resize
from col3d.data.sized import collated
from col3d.geometry import OmnidirectionalCamera, PinholeCamera, angle_between, unit


def coded_angle(normals: Tensor) -> Tensor:
    """Degrees by which vectors (3, n) come back otherwise."""
    there_and_back = from_octahedral(octahedral(normals[:, None])[None])[0]
    return angle_between(normals[:, None], there_and_back.double())


def test_normals_anywhere_on_the_sphere() -> None:
    generator = torch.Generator().manual_seed(0)
    vectors = torch.randn(3, 1_000_000, generator=generator, dtype=torch.float64)
    angles = coded_angle(vectors / vectors.norm(dim=0))
    assert angles.max() < WORST_ANGLE
    assert angles.max() > 0.8 * WORST_ANGLE  # the stated figure is not idle


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("off", [0.0, 1e-6, -1e-6, 1e-3])
def test_normals_at_the_folds(axis: int, off: float) -> None:
    angle = torch.linspace(0, 2 * torch.pi, 100_001, dtype=torch.float64)
    circle = torch.stack([angle.cos(), angle.sin(), torch.full_like(angle, off)]).roll(axis, dims=0)
    assert coded_angle(circle / circle.norm(dim=0)).max() < WORST_ANGLE


@pytest.mark.parametrize("max_depth", [100.0, 200.0, 7.5])
def test_every_depth_code_comes_back(max_depth: float) -> None:
    codes = torch.arange(65536, dtype=torch.float64).view(1, 256, 256)
    item = {
        "image": torch.zeros(3, 256, 256, dtype=torch.uint8),
        "depth": (codes * max_depth / 65535).float(),
        "mask": torch.ones(1, 256, 256, dtype=torch.bool),
    }
    camera = PinholeCamera.from_focal((256, 256), 200.0, 200.0, 127.5, 127.5)
    rest = {"max_depth": max_depth, "lens": 0, "video": "a", "frame": 1}
    found = decode(collated([encode(item, max_depth) | rest]), [camera])["depth"]
    torch.testing.assert_close(found[0].double(), codes * max_depth / 65535, rtol=1e-6, atol=0)


def test_a_decoded_item_is_the_item(item: dict[str, Any]) -> None:
    small = Resize((50, 64), item["camera"])(item)
    given = {**small, "image": (small["image"] * 255).round().to(torch.uint8)}
    rest = {"max_depth": 100.0, "lens": 1, "video": small["video"], "frame": small["frame"]}
    cameras = [OmnidirectionalCamera.c3vdv2().resized((50, 64)), item["camera"].resized((50, 64))]
    found = decode(collated([encode(given, 100.0) | rest] * 2), cameras)
    assert set(found) == set(Batch.__annotations__)
    assert found["video"] == [item["video"]] * 2
    assert found["frame"].tolist() == [item["frame"]] * 2
    for row in range(2):
        assert torch.equal(found["image"][row], small["image"])
        assert torch.equal(found["mask"][row], small["mask"])
        assert torch.equal(found["rays"][row], small["rays"])
        assert (found["depth"][row] - small["depth"]).abs().max() <= 50 / 65535 * 1.001
        known = small["mask"]
        assert angle_between(found["normals"][row], small["normals"])[known].max() < WORST_ANGLE + 1e-3
        assert (found["normals"][row][:, ~known[0]] == 0).all()
    lengths = found["normals"].norm(dim=1)[found["mask"][:, 0]]
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_each_frame_has_the_rays_of_its_own_camera(item: dict[str, Any]) -> None:
    small = Resize((50, 64), item["camera"])(item)
    del small["normals"]
    given = {**small, "image": torch.zeros(3, 50, 64, dtype=torch.uint8)}
    cameras = [OmnidirectionalCamera.c3vdv2().resized((50, 64)), item["camera"].resized((50, 64))]
    rest = {"video": "a", "frame": 0}
    seen = ((1, 100.0), (0, 50.0), (1, 80.0))
    items = [encode(given, depth) | rest | {"lens": lens, "max_depth": depth} for lens, depth in seen]
    found = decode(collated(items), cameras)
    assert "normals" not in found
    for row, (lens, max_depth) in enumerate(seen):
        assert torch.equal(found["rays"][row], cameras[lens].rays())
        inside = small["depth"] <= max_depth
        assert (found["depth"][row] - small["depth"])[inside].abs().max() < 1e-3


def test_directions_of_no_length_are_finite() -> None:
    assert from_octahedral(octahedral(torch.zeros(3, 2, 2))[None]).isfinite().all()
    axes = torch.cat([torch.eye(3), -torch.eye(3)]).T[:, None]
    torch.testing.assert_close(
        from_octahedral(octahedral(axes)[None])[0], unit(axes[None])[0], atol=1e-7, rtol=0
    )

"""Resizing: laws, the same numbers whole or straight from the files, and those of torch's interpolation."""

from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import interpolate

from col3d.data.datasets.c3vd import C3VD
from col3d.data.resize import Resize
from col3d.geometry import angle_between, normals_from_depth

SIZES = [(40, 40), (77, 50), (108, 135), (200, 131)]


def test_a_constant_stays_and_nothing_invalid_gets_in(item: dict[str, Any]) -> None:
    item["mask"] = torch.rand(1, 120, 120, generator=torch.Generator().manual_seed(1)) > 0.05
    item["depth"] = torch.where(item["mask"], 50.0, 0.0)
    item["normals"] = torch.where(item["mask"], torch.tensor([0.0, 0.6, -0.8])[:, None, None], 0.0)
    for size_hw in ((40, 40), (77, 50), (120, 120), (200, 131)):
        small = Resize(size_hw, item["camera"])(item)
        known = small["mask"]
        assert known.float().mean() > 0.7
        torch.testing.assert_close(
            small["depth"][known], torch.full((int(known.sum()),), 50.0), rtol=2e-3, atol=0
        )
        assert (small["depth"][~known] == 0).all()
        assert (small["normals"][~known.expand(3, -1, -1)] == 0).all()
        aim = torch.tensor([0.0, 0.6, -0.8])[:, None, None].expand_as(small["normals"])
        assert angle_between(small["normals"], aim)[known].max() < 0.01


def test_a_pixel_counts_only_where_all_it_is_read_from_do(item: dict[str, Any]) -> None:
    item["mask"] = torch.ones_like(item["mask"])
    item["mask"][0, 50, 61] = False
    half = Resize((60, 60), item["camera"])(item)["mask"]
    assert (~half).nonzero().tolist() == [[0, 25, 30]]
    double = Resize((240, 240), item["camera"])(item)["mask"][0]
    assert not double[99:103, 121:125].any()
    assert double[:98].all()
    assert double[:, :120].all()


def test_resized_rays_are_those_of_the_resized_camera(item: dict[str, Any]) -> None:
    small = Resize((40, 52), item["camera"])(item)
    assert torch.equal(small["rays"], item["camera"].resized((40, 52)).rays())
    assert small["image"].shape == (3, 40, 52)
    assert 0 <= small["image"].min() <= small["image"].max() <= 1
    assert (small["video"], small["frame"]) == (item["video"], item["frame"])
    lengths = small["normals"].norm(dim=0)[small["mask"][0]]
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_resized_maps_see_the_same_sphere(item: dict[str, Any], look: Any) -> None:
    small = Resize((50, 64), item["camera"])(item)
    depth, normals, _ = look("sphere", small["rays"])
    known = small["mask"]
    torch.testing.assert_close(small["depth"][known], depth[0][known].float(), atol=0.05, rtol=0)
    assert angle_between(small["normals"], normals[0].float())[known].max() < 0.1
    derived = normals_from_depth(small["depth"][None], small["rays"], known[None])[0]
    there = known & (derived != 0).any(dim=0, keepdim=True)
    assert angle_between(small["normals"], derived)[there].median() < 0.2


def test_the_same_size_is_the_same_item(item: dict[str, Any]) -> None:
    same = Resize((120, 120), item["camera"])(item)
    for key in ("image", "depth", "normals", "mask", "rays"):
        torch.testing.assert_close(same[key], item[key], atol=1e-6, rtol=0)


def test_items_without_normals(item: dict[str, Any]) -> None:
    del item["normals"]
    small = Resize((40, 40), item["camera"])(item)
    assert "normals" not in small


@pytest.mark.parametrize("size_hw", SIZES)
def test_maps_are_those_of_torch(item: dict[str, Any], size_hw: tuple[int, int]) -> None:
    def read_off(values: torch.Tensor) -> torch.Tensor:
        return interpolate(values[None], size_hw, mode="bilinear", align_corners=False)[0]

    small = Resize(size_hw, item["camera"])(item)
    known = read_off(item["mask"].double()) > 0.999
    assert torch.equal(small["mask"], known)
    torch.testing.assert_close(small["depth"][known], read_off(item["depth"].double())[known].float())
    aim = read_off(item["normals"].double()).float()
    assert angle_between(small["normals"], aim)[known].max() < 1e-3
    image = interpolate(item["image"][None].double(), size_hw, mode="bilinear", antialias=True)[0]
    assert (small["image"] - image).abs().max() < 1.6 / 255  # rounded along either side


@pytest.mark.parametrize("size_hw", SIZES)
@pytest.mark.parametrize("normals", ["stored", "derived", "none"])
def test_straight_from_the_files_is_the_same(
    write_video, lens, size_hw: tuple[int, int], normals: str
) -> None:
    frames = C3VD(write_video(), ["cecum_t1_a"], normals=normals, camera=lens)
    resize = Resize(size_hw, lens)
    whole, straight = resize(frames[1]), resize.read(frames, 1)
    assert straight["image"].dtype == torch.uint8
    assert torch.equal(straight["image"].float() / 255, whole["image"])
    assert ("normals" in straight) == (normals != "none")
    for key in ("depth", "mask", "normals"):
        assert key not in straight or torch.equal(straight[key], whole[key]), key


def test_mixed_truth_is_that_of_published_programs(item: dict[str, Any]) -> None:
    mixed = Resize((50, 64), item["camera"], "mixed")(item)
    plain = interpolate(item["depth"][None].double(), (50, 64), mode="bilinear")[0].float()
    torch.testing.assert_close(mixed["depth"], plain)
    assert torch.equal(mixed["mask"], plain > 0)
    assert mixed["mask"].sum() > Resize((50, 64), item["camera"])(item)["mask"].sum()


def test_only_pixels_around_new_centres_are_taken(lens) -> None:
    taken = Resize((20, 30), lens).take(np.arange(108 * 135).reshape(108, 135))
    assert taken.shape == (40, 60)
    assert taken[0].tolist()[:4] == [2 * 135 + 1, 2 * 135 + 2, 2 * 135 + 6, 2 * 135 + 7]

"""Transforms of whole items: laws, and normals that stay those of the depth."""

from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import interpolate
from torch.utils.data import default_collate

from col3d.batch import Batch
from col3d.data.transforms import Augment, crop, draws_of, flip, jitter, rotate
from col3d.geometry import Camera, OmnidirectionalCamera, angle_between, normals_from_depth

MAPS = ("image", "depth", "normals", "mask", "rays")


def batch_of(item: dict[str, Any], count: int = 2) -> Batch:
    frames = [{**item, "frame": number} for number in range(count)]
    batch: Batch = default_collate([{k: v for k, v in f.items() if k != "camera"} for f in frames])
    return batch


def sphere_batch(look: Any, camera: Camera, count: int = 1) -> Batch:
    """The sphere as one camera sees it, in each of the frames."""
    depth, normals, mask = look("sphere", camera.rays())
    maps = {
        "image": torch.rand(1, 3, *camera.size_hw, generator=torch.Generator().manual_seed(0)),
        "depth": torch.where(mask, depth, 0.0).float(),
        "normals": torch.where(mask, normals, 0.0).float(),
        "mask": mask,
        "rays": camera.rays()[None],
    }
    frames: Any = {key: values.expand(count, -1, -1, -1).clone() for key, values in maps.items()}
    return {**frames, "video": ["a"] * count, "frame": torch.arange(count)}


def derived_error(batch: Batch) -> Tensor:
    """Degrees between the normals of a batch and those of its depth."""
    derived = normals_from_depth(batch["depth"], batch["rays"], batch["mask"])
    return angle_between(batch["normals"], derived)[batch["mask"] & (derived != 0).any(dim=1, keepdim=True)]


def middle(values: Tensor) -> Tensor:
    return values[..., 30:-30, 30:-30]


def test_items_without_normals(item: dict[str, Any]) -> None:
    del item["normals"]
    moved = Augment(rotation=10.0, flip=1.0, jitter=1.0)(batch_of(item), draws_of(batch_of(item), 0, 0))
    assert set(moved) == set(Batch.__annotations__) - {"normals"}


# mirroring


def test_flipping_twice_is_nothing(item: dict[str, Any]) -> None:
    batch, both = batch_of(item), torch.tensor([True, True])
    once = flip(batch, both)
    twice = flip(once, both)
    for key in MAPS:
        assert torch.equal(twice[key], batch[key])  # type: ignore[literal-required]
        assert not torch.equal(once[key], batch[key])  # type: ignore[literal-required]


def test_only_the_chosen_are_mirrored(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    found = flip(batch, torch.tensor([True, False]))
    mirror = torch.tensor([-1.0, 1.0, 1.0])[:, None, None]
    assert torch.equal(found["image"][0], batch["image"][0].flip(-1))
    assert torch.equal(found["normals"][0], batch["normals"][0].flip(-1) * mirror)
    torch.testing.assert_close(found["rays"][0], item["camera"].flipped().rays(), atol=1e-6, rtol=0)
    for key in MAPS:
        assert torch.equal(found[key][1], batch[key][1])  # type: ignore[literal-required]
    assert derived_error(found).median() < 0.05


# turning


def test_turning_by_nothing_is_nothing(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    found = rotate(batch, torch.zeros(2))
    for key in MAPS:
        torch.testing.assert_close(found[key], batch[key], atol=1e-4, rtol=1e-5)  # type: ignore[literal-required]


@pytest.mark.parametrize("degrees", [7.0, -40.0])
def test_there_and_back(item: dict[str, Any], degrees: float) -> None:
    batch, turn = batch_of(item), torch.tensor([degrees, -degrees])
    found = rotate(rotate(batch, turn), -turn)
    for key, largest in (("depth", 0.1), ("normals", 5e-3), ("rays", 5e-3)):
        torch.testing.assert_close(
            middle(found[key]),
            middle(batch[key]),
            atol=largest,
            rtol=0,  # type: ignore[literal-required]
        )


def test_each_frame_turns_by_its_own_angle(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    found = rotate(batch, torch.tensor([0.0, 25.0]))
    alone = rotate(batch_of(item, 1), torch.tensor([25.0]))
    for key in ("image", "rays"):
        torch.testing.assert_close(found[key][0], batch[key][0], atol=1e-4, rtol=1e-5)  # type: ignore[literal-required]
        torch.testing.assert_close(found[key][1:], alone[key], atol=1e-4, rtol=1e-5)  # type: ignore[literal-required]


@pytest.mark.parametrize("size_hw", [(120, 120), (108, 135), (150, 60)])
@pytest.mark.parametrize("degrees", [1.0, 15.0, -35.0, 90.0])
def test_the_scene_turns_rigidly(look: Any, size_hw: tuple[int, int], degrees: float) -> None:
    """Normals that are turned are those of the turned depth, whatever the shape of the pixels."""
    batch = sphere_batch(look, OmnidirectionalCamera.c3vd().resized(size_hw))
    found = rotate(batch, torch.tensor([degrees]))
    assert found["mask"].float().mean() > 0.3
    errors = derived_error(found)
    assert errors.median() < 0.3
    assert errors.quantile(0.95) < 2
    known = found["mask"].expand(-1, 3, -1, -1)
    assert ((found["normals"] * found["rays"]).sum(dim=1, keepdim=True)[found["mask"]] < 0).all()
    torch.testing.assert_close(found["rays"].norm(dim=1), torch.ones(1, *size_hw))
    assert (found["normals"][~known] == 0).all()
    points = found["rays"] / found["rays"][:, 2:] * found["depth"]
    turn = torch.tensor(degrees).deg2rad()
    centre = torch.stack(
        [3 * turn.cos() + 4 * turn.sin(), 3 * turn.sin() - 4 * turn.cos(), torch.tensor(5.0)]
    )
    radius = (points - centre[:, None, None]).norm(dim=1, keepdim=True)[found["mask"]]
    torch.testing.assert_close(radius, torch.full_like(radius, 30.0), atol=0.3, rtol=0)


@pytest.mark.parametrize("degrees", [10.0, -25.0, 90.0])
def test_square_pixels_turn_as_the_camera_does(degrees: float) -> None:
    camera = OmnidirectionalCamera.c3vd().cropped(140, 275, 800, 800).resized((80, 80))
    rays = camera.rays()[None].clone()
    batch: Batch = {
        "image": rays.abs(),
        "depth": torch.ones(1, 1, 80, 80),
        "mask": torch.ones(1, 1, 80, 80, dtype=torch.bool),
        "rays": rays,
        "video": ["a"],
        "frame": torch.tensor([0]),
    }
    found = rotate(batch, torch.tensor([degrees]))
    apart = angle_between(found["rays"], camera.rolled(degrees).rays()[None])[found["mask"]]
    assert apart.max() < 0.3  # a pixel is 0.7 degrees wide
    assert apart.median() < 0.1


def test_nothing_from_outside_counts(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    batch["mask"][:] = True
    batch["depth"][:] = 50.0
    found = rotate(batch, torch.tensor([30.0, 45.0]))
    assert not found["mask"][..., 0, 0].any()
    assert (found["depth"][~found["mask"]] == 0).all()
    torch.testing.assert_close(
        found["depth"][found["mask"]], torch.full_like(found["depth"][found["mask"]], 50.0)
    )


# cropping


CORNERS = torch.tensor([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
WINDOWS = ((0, 0), (0, 70), (50, 0), (50, 70))
"""Top and left of the half as large window in each corner of 100 x 140 pixels."""


@pytest.fixture
def wide(look: Any) -> Batch:
    return sphere_batch(look, OmnidirectionalCamera.c3vd().resized((100, 140)), count=4)


def test_the_whole_frame_is_cropped_to_itself(wide: Batch) -> None:
    found = crop(wide, 1.0, CORNERS)
    assert torch.equal(found["mask"], wide["mask"])
    for key in ("image", "depth", "normals", "rays"):
        torch.testing.assert_close(found[key], wide[key], atol=1e-4, rtol=1e-5)  # type: ignore[literal-required]


def test_cropped_rays_and_images_are_those_of_the_cropped_camera(wide: Batch) -> None:
    found = crop(wide, 0.5, CORNERS)
    inside = (..., slice(1, -1), slice(1, -1))  # pixels at the frame's border lie between it and nothing
    for i, (top, left) in enumerate(WINDOWS):
        camera = OmnidirectionalCamera.c3vd().resized((100, 140)).cropped(top, left, 50, 70)
        apart = angle_between(found["rays"][i], camera.resized((100, 140)).rays())
        assert apart[inside].max() < 0.01
        assert apart.max() < 0.8  # up to half a pixel of 1 degree
        window = wide["image"][i : i + 1, :, top : top + 50, left : left + 70]
        enlarged = interpolate(window, (100, 140), mode="bilinear")[0]
        torch.testing.assert_close(found["image"][i][inside], enlarged[inside], atol=1e-4, rtol=0)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.3])
def test_the_scene_stays_where_it_is_when_cropped(wide: Batch, look: Any, share: float) -> None:
    """Neither depth nor a normal changes, so that normals that are cropped are those of the cropped depth."""
    found = crop(wide, share, torch.tensor([[0.0, 0.1], [0.2, 1.0], [0.5, 0.5], [0.9, 0.6]]))
    assert (found["mask"].float().mean(dim=(1, 2, 3)) > 0.3).all()
    errors = derived_error(found)
    assert errors.median() < 0.3
    assert errors.quantile(0.95) < 2
    for i in range(4):
        depth, normals, _ = look("sphere", found["rays"][i])
        known = found["mask"][i]
        torch.testing.assert_close(found["depth"][i][known], depth[0][known].float(), atol=0.1, rtol=0)
        assert angle_between(found["normals"][i], normals[0].float())[known].max() < 0.5


def test_nothing_unknown_counts_in_a_crop(wide: Batch) -> None:
    unknown = torch.zeros(4, 1, 100, 140, dtype=torch.bool)
    unknown[..., 20:30, 20:30] = True
    wide["mask"], wide["depth"] = ~unknown, torch.where(unknown, 999.0, 50.0)
    found = crop(wide, 0.5, CORNERS)
    known = found["mask"]
    torch.testing.assert_close(found["depth"][known], torch.full_like(found["depth"][known], 50.0))
    assert (found["depth"][~known] == 0).all()
    assert (found["normals"][~known.expand(-1, 3, -1, -1)] == 0).all()
    hole = torch.zeros(100, 140, dtype=torch.bool)
    hole[39:61, 39:61] = True  # the unknown pixels twice as large, and those that are read from one of them
    hole[0], hole[:, 0] = True, True  # half of these is read from outside the frame
    assert torch.equal(~known[0, 0], hole)


# photometry


def test_jitter_keeps_the_range_and_order() -> None:
    image = torch.linspace(0, 1, 300).view(1, 3, 10, 10).expand(2, -1, -1, -1)
    found = jitter(image, torch.tensor([0.9, 1.1]), torch.tensor([[1.3, 0.7, 1.0], [1.0, 1.0, 1.0]]))
    assert 0 <= found.min() <= found.max() <= 1
    assert (found.flatten(2).diff(dim=-1) >= 0).all()
    torch.testing.assert_close(jitter(image, torch.ones(2), torch.ones(2, 3)), image, atol=2e-6, rtol=0)
    assert (found[1] <= image[1] + 1e-5).all()  # gamma above one darkens


# augmentation


FULL = Augment(rotation=10.0, flip=0.5, jitter=0.5)
CROP = Augment(rotation=0.0, crop=0.8)
each = pytest.mark.parametrize("augment", [FULL, CROP])


@each
def test_draws_depend_on_the_frame_and_not_on_its_batch(item: dict[str, Any], augment: Augment) -> None:
    batch = batch_of(item, 6)
    together = augment(batch, draws_of(batch, seed=1, epoch=2))
    for i in (5, 0, 3):
        single: Any = {k: v[i : i + 1] for k, v in batch.items()}  # type: ignore[index]
        alone = augment(single, draws_of(single, seed=1, epoch=2))
        for key in ("image", "rays"):
            torch.testing.assert_close(alone[key][0], together[key][i], atol=1e-3, rtol=1e-4)  # type: ignore[literal-required]
        assert (alone["mask"][0] == together["mask"][i]).float().mean() > 0.99


@each
def test_draws_are_reproducible_and_differ_by_seed_epoch_frame_and_video(
    item: dict[str, Any], augment: Augment
) -> None:
    batch = batch_of(item, 4)
    torch.manual_seed(0)
    first = augment(batch, draws_of(batch, seed=1, epoch=2))
    torch.manual_seed(99)
    again = augment(batch, draws_of(batch, seed=1, epoch=2))
    for key in MAPS:
        assert torch.equal(first[key], again[key])  # type: ignore[literal-required]
    other_video: Any = batch | {"video": ["desc_t4_a"] * 4}
    others = draws_of(batch, 2, 2), draws_of(batch, 1, 3), draws_of(other_video, 1, 2)
    for other in (augment(batch, draws) for draws in others):
        assert all(not torch.equal(first["rays"][i], other["rays"][i]) for i in range(4))
    assert not torch.equal(first["rays"][0], first["rays"][1])


def test_shares_of_the_draws(item: dict[str, Any]) -> None:
    small = batch_of({k: v[:, :3, :3] if isinstance(v, Tensor) else v for k, v in item.items()}, 400)
    found = Augment(rotation=0.0, flip=0.3, jitter=0.6)(small, draws_of(small, 0, 0))
    mirrored = (found["depth"][:, 0, 0, 0] - small["depth"][:, 0, 0, 0]).abs() + (
        found["rays"] - small["rays"]
    ).abs().amax(dim=(1, 2, 3)) > 1e-6
    assert 0.2 < mirrored.float().mean() < 0.4
    straight = torch.where(mirrored[:, None, None, None], found["image"].flip(-1), found["image"])
    changed = (straight - small["image"]).abs().amax(dim=(1, 2, 3)) > 1e-4
    assert 0.5 < changed.float().mean() < 0.7


def test_defaults_turn_by_a_degree_at_most_and_do_nothing_else(item: dict[str, Any]) -> None:
    batch = batch_of(item, 30)
    found = Augment()(batch, draws_of(batch, 0, 0))
    draws = draws_of(batch, 0, 0)
    assert torch.equal(found["image"], rotate(batch, 2 * draws[:, 1] - 1)["image"])
    turned = angle_between(found["rays"], batch["rays"])[..., 20:-20, 20:-20]
    assert turned.max() < 0.05  # the direction of a pixel stays, up to what is not radially symmetric
    assert not torch.equal(found["image"], batch["image"])
    assert draws.min() >= 0
    assert draws.max() < 1
    assert draws[:, 1].min() < 0.2
    assert draws[:, 1].max() > 0.8


def test_windows_are_anywhere_in_the_frame(item: dict[str, Any]) -> None:
    batch = batch_of(item, 30)
    found = CROP(batch, draws_of(batch, 0, 0))
    draws = draws_of(batch, 0, 0)[:, 8:]
    assert torch.equal(found["image"], crop(batch, 0.8, draws)["image"])
    assert draws.shape == (30, 2)
    assert (draws.amin(dim=0) < 0.2).all()
    assert (draws.amax(dim=0) > 0.8).all()


def test_nothing_to_do(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    assert Augment(rotation=0.0)(batch, draws_of(batch, 0, 0)) is batch


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float64])
def test_types_of_images(item: dict[str, Any], dtype: torch.dtype) -> None:
    batch = batch_of(item)
    draws = draws_of(batch, 0, 0)
    expected = FULL(batch, draws)
    found = FULL(batch | {"image": batch["image"].to(dtype)}, draws)  # type: ignore[arg-type]
    torch.testing.assert_close(found["image"].float(), expected["image"], atol=1e-2, rtol=0)
    assert torch.equal(found["depth"], expected["depth"])


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_another_device_draws_the_same(item: dict[str, Any]) -> None:
    batch = batch_of(item)
    there: Any = {k: v.cuda() if isinstance(v, Tensor) else v for k, v in batch.items()}
    draws = draws_of(batch, 0, 0)
    found, expected = FULL(there, draws.cuda()), FULL(batch, draws)
    for key in MAPS:
        assert found[key].is_cuda  # type: ignore[literal-required]
    torch.testing.assert_close(found["depth"].cpu(), expected["depth"], atol=1e-2, rtol=1e-3)

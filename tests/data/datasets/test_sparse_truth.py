"""Truth with holes stays known through files, resizing, codes, stores, augmentation and scores."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from col3d.batch import Batch, normals_mask
from col3d.data.cache import Recipe, Stored, read_video
from col3d.data.cache.codes import decode, encode
from col3d.data.cache.write import write_video
from col3d.data.datasets.folder import FolderFrames
from col3d.data.resize import Resize
from col3d.data.sized import Resized, collated
from col3d.data.transforms import crop, rotate
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.losses.weighted import WeightedLoss
from col3d.metrics import Protocol
from col3d.training.tasks import SupervisedTask

SIZE = (48, 66)
UNIT = 1 / 256


def written(root: Path, share: float, frames: int = 2) -> Path:
    """A video whose depth is known at a share of its pixels, at random."""
    plain = {"model": "pinhole", "size": list(SIZE), "fx": 60.0, "fy": 60.0, "cx": 32.5, "cy": 23.5}
    (root / "a").mkdir(parents=True)
    (root / "camera.json").write_text(json.dumps(plain))
    for number in range(frames):
        draw = np.random.default_rng(number)
        codes = draw.integers(256 * 10, 256 * 60, SIZE) * (draw.random(SIZE) < share)
        cv2.imwrite(str(root / "a" / f"{number}.png"), draw.integers(0, 255, (*SIZE, 3), np.uint8))
        cv2.imwrite(str(root / "a" / f"{number}_depth.png"), codes.astype(np.uint16))
    return root


@pytest.fixture
def frames(tmp_path: Path) -> Callable[..., FolderFrames]:
    def read(share: float, normals: str = "none") -> FolderFrames:
        root = written(tmp_path / f"{share}_{normals}", share)
        return FolderFrames(root, ["a"], "{}.png", "{}_depth.png", UNIT, 100.0, normals=normals)

    return read


def by_the_rule(depth: np.ndarray, size_hw: tuple[int, int], i: int, j: int) -> list[float]:
    """What a new pixel may be: between four known ones, or one of the nearest known ones inside it."""
    (height, width), down, across = depth.shape, depth.shape[0] / size_hw[0], depth.shape[1] / size_hw[1]
    y, x = (i + 0.5) * down - 0.5, (j + 0.5) * across - 0.5
    rows = [min(max(math.floor(y) + k, 0), height - 1) for k in (0, 1)]
    columns = [min(max(math.floor(x) + k, 0), width - 1) for k in (0, 1)]
    lower, right = min(max(y, 0), height - 1) % 1, min(max(x, 0), width - 1) % 1
    weights = np.outer([1 - lower, lower], [1 - right, right])
    around = depth[np.ix_(rows, columns)]
    if (around[weights > 1e-3] > 0).all():
        return [(around * weights).sum()]
    inside = [
        (round((v - y) ** 2 + (u - x) ** 2, 6), depth[v, u])
        for v in range(math.floor(i * down), math.ceil((i + 1) * down))
        for u in range(math.floor(j * across), math.ceil((j + 1) * across))
        if depth[v, u] > 0
        and i * down <= v + 0.5 < (i + 1) * down
        and j * across <= u + 0.5 < (j + 1) * across
    ]
    if inside:
        return [value for far, value in inside if far == min(inside)[0]]
    return [depth[math.floor((i + 0.5) * down), math.floor((j + 0.5) * across)]]


@pytest.mark.parametrize("share", [0.02, 0.4, 0.9, 1.0])
@pytest.mark.parametrize("size_hw", [(24, 33), (13, 20), (7, 66), (60, 30), (96, 132)])
def test_a_new_pixel_is_what_the_rule_says(
    frames: Callable[..., FolderFrames], share: float, size_hw: tuple[int, int]
) -> None:
    read = frames(share)
    found = Resize(size_hw, read.camera).read(read, 0)
    stored = read[0]["depth"][0].double().numpy()
    for i, j in np.ndindex(size_hw):
        value, allowed = found["depth"][0, i, j].item(), by_the_rule(stored, size_hw, i, j)
        assert min(abs(value - other) for other in allowed) < 1e-3
        assert found["mask"][0, i, j].item() == (allowed[0] > 0)


def test_dense_truth_is_resized_as_it_was(frames: Callable[..., FolderFrames]) -> None:
    read = frames(1.0)
    item, small = read[0], Resize((13, 20), read.camera)
    assert torch.equal(small.read(read, 0)["depth"], small(item)["depth"])


def test_depth_counts_where_its_normals_are_not_derivable(frames: Callable[..., FolderFrames]) -> None:
    depth, both = frames(0.4)[0], frames(0.4, "derived")[0]
    assert torch.equal(depth["mask"], both["mask"])
    assert depth["mask"].float().mean() == pytest.approx(0.4, abs=0.03)
    assert 0 < (both["normals"] != 0).any(dim=0).float().mean() < 0.2


def test_codes_keep_depth_without_a_normal(frames: Callable[..., FolderFrames]) -> None:
    read = frames(0.4, "derived")
    resize, sized = Resize((24, 33), read.camera), Resized(read, (24, 33))
    for index in range(len(read)):
        item, decoded = resize.read(read, index), sized[index]
        assert torch.equal(decoded["mask"], item["mask"])
        assert torch.equal((decoded["normals"] != 0).any(dim=0), (item["normals"] != 0).any(dim=0))
    assert (item["mask"] & ~(item["normals"] != 0).any(dim=0)).any()


def test_codes_of_frames_with_all_normals_are_those_of_before(frames: Callable[..., FolderFrames]) -> None:
    item = Resize((24, 33), frames(1.0, "derived").camera).read(frames(1.0, "none"), 0)
    normals = torch.nn.functional.normalize(torch.randn(3, 24, 33), dim=0) * item["mask"]
    codes = encode(item | {"normals": normals}, 100.0)["normals"]
    assert codes.min() >= -32767


def test_a_store_holds_the_same(frames: Callable[..., FolderFrames], tmp_path: Path) -> None:
    read = frames(0.3, "derived")
    sized = Resized(read, (24, 33))
    recipe = Recipe("folder", (24, 33), "derived", 100.0, sized.cameras[0], {}, read.dense_truth)
    write_video(tmp_path / "store", sized, recipe, lambda: None)
    video = read_video(tmp_path / "store" / "a")
    assert video is not None
    stored = Stored([(video, [0, 1])])
    assert not stored.dense_truth
    for key in ("depth", "mask", "normals"):
        assert torch.equal(stored[1][key], sized[1][key])
    dense = Recipe("folder", (24, 33), "derived", 100.0, sized.cameras[0])
    assert video.differs(dense) == "another resize"


def batch_of(frames: FolderFrames, size_hw: tuple[int, int] = (24, 33)) -> Batch:
    sized = Resized(frames, size_hw)
    return decode(collated([sized.encoded(0), sized.encoded(1)]), sized.cameras)


def test_a_turn_keeps_most_of_it(frames: Callable[..., FolderFrames]) -> None:
    batch, degrees = batch_of(frames(0.05, "derived")), torch.tensor([1.0, -1.0])
    before = batch["mask"].float().mean().item()
    assert rotate(batch, degrees, sparse=True)["mask"].float().mean().item() == pytest.approx(before, rel=0.1)
    assert rotate(batch, degrees)["mask"].float().mean() < 0.1 * before


def test_what_a_turn_or_a_window_moves_is_what_was_there(frames: Callable[..., FolderFrames]) -> None:
    batch = batch_of(frames(0.05))
    for moved in (
        rotate(batch, torch.tensor([3.0, -2.0]), sparse=True),
        crop(batch, 0.7, torch.tensor([[0.2, 0.9], [0.5, 0.0]]), sparse=True),
    ):
        for i in range(2):
            known = moved["depth"][i][moved["mask"][i]]
            assert len(known) > 5
            there = torch.isin(known, batch["depth"][i][batch["mask"][i]])
            assert there.float().mean() > 0.9  # the rest lies between four known ones
        assert (moved["depth"][~moved["mask"]] == 0).all()


class Constant(torch.nn.Module):
    """One plane and one normal, which learn."""

    tasks = ("depth", "normals")

    def __init__(self) -> None:
        super().__init__()
        self.depth = torch.nn.Parameter(torch.tensor(40.0))
        self.normal = torch.nn.Parameter(torch.tensor([0.1, 0.2, -1.0]))

    def forward(self, image: Tensor, rays: Tensor) -> Any:
        shape = (len(image), 1, *image.shape[-2:])
        normals = self.normal[:, None, None].expand(len(image), 3, *shape[-2:])
        return {"depth": self.depth.expand(shape), "normals": normals}


def test_losses_and_scores_of_normals_count_known_normals(frames: Callable[..., FolderFrames]) -> None:
    batch = batch_of(frames(0.5, "derived"))
    known = normals_mask(batch)
    assert 0 < known.sum() < batch["mask"].sum()
    network = Constant()
    prediction = network(batch["image"], batch["rays"])
    loss = WeightedLoss((1.0, 1.0), {"depth": "silog", "normals": "normal_l1"})(prediction, batch)
    expected = (prediction["normals"] - batch["normals"]).abs()[known.expand(-1, 3, -1, -1)].mean()
    torch.testing.assert_close(loss["normals"], expected)
    changed = batch | {"normals": torch.where(known, batch["normals"], 0.0)}
    scores = Protocol().score(prediction, changed)
    pair = prediction["normals"].double(), batch["normals"].double()
    angles = torch.rad2deg(torch.acos(torch.nn.functional.cosine_similarity(*pair)))
    for i in range(2):
        assert scores["angle_mean"][i].item() == pytest.approx(angles[i][known[i, 0]].mean().item(), abs=1e-3)
        assert scores["pixels"][i] == batch["mask"][i].sum()


def test_a_frame_without_normals_has_none_in_the_table(
    frames: Callable[..., FolderFrames], tmp_path: Path
) -> None:
    batch = batch_of(frames(0.5, "derived"))
    batch["normals"][1] = 0
    scores = Protocol().score(Constant()(batch["image"], batch["rays"]), batch)
    table = PerFrameTable(tmp_path / "per_frame.csv", {"model": "m"}, lambda video: ("", ""))
    table.add(batch, scores, {})
    assert "angle_mean" in table.rows[0]
    assert "angle_mean" not in table.rows[1]
    assert table.rows[1]["abs_rel"] > 0  # type: ignore[operator]
    table.save()


def test_validation_means_are_over_frames_with_normals(frames: Callable[..., FolderFrames]) -> None:
    batch = batch_of(frames(0.5, "derived"))
    task = SupervisedTask(Constant(), WeightedLoss((1.0, 1.0), {"depth": "silog", "normals": "normal_l1"}))
    batch["normals"][1] = 0
    task.validation_step(batch, 0)
    assert task.val_metrics["normals"].frames == 1
    assert task.val_metrics["depth"].frames == 2
    assert task.val_metrics["normals"].compute()["angle_mean"].isfinite()

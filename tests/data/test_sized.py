"""Several data sets as one: each frame keeps its own camera, depth and name."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from col3d.data.datamodule import FrameDataModule
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.folder import FolderFrames
from col3d.data.sized import Joined, Resized

SIZE = (64, 80)


@pytest.fixture
def both(write_video: Any, lens: Any, tmp_path: Path) -> tuple[Resized, Resized]:
    """A video of C3VD, and one seen by a pinhole whose depth may be three times as large."""
    clip = tmp_path / "own" / "clip"
    clip.mkdir(parents=True)
    depth = np.linspace(10, 290, 60 * 80).reshape(60, 80).astype(np.float32)
    for number in range(2):
        cv2.imwrite(str(clip / f"{number}.png"), np.full((60, 80, 3), 90 + number, np.uint8))
        cv2.imwrite(str(clip / f"{number}_depth.tiff"), depth)
    camera = {"model": "pinhole", "size": [60, 80], "fx": 70.0, "fy": 70.0, "cx": 39.5, "cy": 29.5}
    (clip.parent / "camera.json").write_text(json.dumps(camera))
    own = FolderFrames(clip.parent, ["clip"], "{}.png", "{}_depth.tiff", 1.0, 300.0)
    return Resized(C3VD(write_video(), ["cecum_t1_a"], camera=lens), SIZE), Resized(own, SIZE)


def test_frames_of_several_data_sets(both: tuple[Resized, Resized]) -> None:
    first, second = both
    joined = Joined(both)
    assert len(joined) == 5
    assert joined.videos == ["cecum_t1_a"] * 3 + ["clip"] * 2
    for index, expected in enumerate([*(first[i] for i in range(3)), *(second[i] for i in range(2))]):
        found = joined[index]
        assert found["video"] == expected["video"]
        for key in ("image", "depth", "normals", "mask", "rays", "frame"):
            assert torch.equal(found[key], expected[key]), key
    assert joined[4]["depth"].max() > 200


@pytest.mark.parametrize("workers", [0, 1])
def test_a_batch_of_several_data_sets(both: tuple[Resized, Resized], workers: int) -> None:
    joined = Joined(both)
    module = FrameDataModule({"val": joined, "test": both[1]}, batch_size=5, workers=workers)
    batch = module.on_after_batch_transfer(next(iter(module.val_dataloader())), 0)
    for row in range(5):
        for key in ("image", "depth", "normals", "mask", "rays"):
            assert torch.equal(batch[key][row], joined[row][key]), key  # type: ignore[literal-required]
    alone = module.on_after_batch_transfer(next(iter(module.test_dataloader())), 0)
    assert torch.equal(alone["rays"][0], both[1].cameras[0].rays())

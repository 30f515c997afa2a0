"""C3VDv2: the codes of C3VD in other folders, seen by another lens."""

from pathlib import Path
from typing import Any

import pytest
import torch
from refusals import refused

from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.data.splits import expand
from col3d.errors import DataError
from col3d.geometry import OmnidirectionalCamera


@pytest.fixture
def root(write_video: Any) -> Path:
    """Two videos of C3VD, moved to where the second part keeps its files."""
    kinds = {
        "color.png": "rgb/{}.png",
        "depth.tiff": "depth/{}_depth.tiff",
        "normals.tiff": "normals/{}_normals.tiff",
    }
    for video in ("c1_cecum_t1_v1", "c2_desc_t2_v1"):
        folder = write_video(video) / video
        for old, new in kinds.items():
            for path in folder.glob(f"*_{old}"):
                target = folder / new.format(path.name.split("_")[0])
                target.parent.mkdir(exist_ok=True)
                path.rename(target)
    return folder.parent


def test_frames_are_read_from_their_folders(root: Path, lens: Any, look: Any) -> None:
    frames = C3VDv2(root, ["c1_cecum_t1_v1"], camera=lens)
    assert [frame.number for frame in frames.frames] == [0, 1, 2]
    assert frames.releases == {"c1_cecum_t1_v1": "current"}
    item = frames[2]
    depth, normals, _ = look("tube", lens.rays())
    known = item["mask"]
    torch.testing.assert_close(item["depth"][known], depth[0][known].float(), atol=1e-3, rtol=0)
    cosine = (item["normals"] * normals[0].float()).sum(dim=0, keepdim=True)
    assert cosine[known].min() > 0.9999
    assert (item["image"][0] == 2 / 255).all()


def test_its_lens_is_its_own(root: Path) -> None:
    assert C3VDv2(root, []).camera == OmnidirectionalCamera.c3vdv2()
    with refused(DataError, root / "c1_cecum_t1_v1" / "rgb" / "0000.png", "1080 x 1350"):
        C3VDv2(root, ["c1_cecum_t1_v1"])


def test_a_missing_file_is_named_with_its_folder(root: Path, lens: Any) -> None:
    (root / "c2_desc_t2_v1" / "normals" / "0001_normals.tiff").unlink()
    with refused(DataError, root / "c2_desc_t2_v1", "frame 1 ", "normals/0001_normals.tiff"):
        C3VDv2(root, ["c2_desc_t2_v1"], camera=lens)


def test_wildcards_name_its_videos(root: Path) -> None:
    present = list(C3VDv2.video_folders(root))
    assert expand(["c1_*", "c2_desc_t2_v1"], present) == ["c1_cecum_t1_v1", "c2_desc_t2_v1"]
    assert expand(["c?_*"], present) == present
    with refused(DataError, "split entry 'x*'", "data.root"):
        expand(["x*"], present)

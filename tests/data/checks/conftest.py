from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from spheres import (
    CURRENT,
    LENS,
    SIZE,
    Channels,
    Check,
    Write,
    pinhole_normals,
    pose_of,
    see,
    stored,
    write_poses,
)

from col3d.data.checks import ExpectedVideo, VideoReport, check_chunk, duplicates, plan_video
from col3d.data.checks.video_summary import summarise_video
from col3d.data.datasets.c3vd import C3VD


@pytest.fixture
def write_sphere(tmp_path: Path) -> Write:
    """Write a video of the sphere below tmp_path / "data" and return that root."""

    def write(
        video: str = "cecum_t1_a",
        numbers: Sequence[int] = (0, 1, 2),
        channels: Channels = CURRENT,
        clipped: bool = False,
        pinhole: bool = False,
        seed: int = 0,
    ) -> Path:
        root = tmp_path / "data"
        (root / video).mkdir(parents=True)
        random = np.random.default_rng([seed, *map(ord, video)])
        for number in numbers:
            depth, normals, shown = see(pose_of(number))
            codes = stored(pinhole_normals(depth) if pinhole else normals, channels, clipped)
            name = str(root / video / f"{number:04d}")
            color = random.integers(0, 256, (*SIZE, 3), np.uint8)
            assert cv2.imwrite(f"{name}_color.png", color)
            assert cv2.imwrite(f"{name}_depth.tiff", np.rint(depth * shown * 655.35).astype(np.uint16))
            assert cv2.imwrite(f"{name}_normals.tiff", (codes * shown[..., None])[..., ::-1])
        write_poses(root / video / "pose.txt", [pose_of(n) for n in range(max(numbers) + 1)])
        return root

    return write


@pytest.fixture
def frames(tmp_path: Path) -> C3VD:
    """A data set at the size of the spheres that can look for files; its root may be written later."""
    return C3VD(tmp_path / "data", [], camera=LENS)


@pytest.fixture
def check(frames: C3VD) -> Check:
    """All there is to check of one video."""

    def run(root: Path, video: str = "cecum_t1_a", fast: bool = False, **asked: Any) -> VideoReport:
        plan = plan_video(frames, video, root / video, fast)
        reports = [report for chunk in plan.chunks for report in check_chunk(frames, chunk, lambda: None)]
        found = summarise_video(frames, plan, reports, ExpectedVideo(**{"frames": {}, **asked}))
        duplicates({video: found}, {video: plan}, reports)
        return found

    return run

"""Where the endoscope goes: back along the lumen, aside, near the wall and down the lumen."""

import numpy as np
import pytest

from col3d.phantom import PARTS, PhantomSettings
from col3d.phantom.trajectory import CLEARANCE
from col3d.phantom.write import Scene, scene_of

pytestmark = pytest.mark.end_to_end

PLAIN = ("cecum_t1_a", "trans_t1_a", "desc_t4_a", "sigmoid_t1_a")
DRAWN = tuple(f"{video}_s{seed}" for video in PLAIN for seed in (1, 2, 3))


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {
        video: scene_of(video, PhantomSettings((54, 68), 8, randomise=parts, videos=(video,)))
        for parts, videos in (((), PLAIN), (PARTS, DRAWN))
        for video in videos
    }


def from_wall(scene: Scene) -> list[float]:
    """Least distance in mm of each place to the wall."""
    wall = scene.renderer.colon.vertices
    return [float(np.linalg.norm(wall - place, axis=1).min()) for place in scene.poses[:, :3, 3]]


@pytest.mark.parametrize("video", [*PLAIN, *DRAWN])
def test_it_is_withdrawn(scenes: dict[str, Scene], video: str) -> None:
    line = scenes[video].renderer.colon.centreline
    places = scenes[video].poses[:, :3, 3]
    at = [line.at[np.linalg.norm(line.points - place, axis=1).argmin()] for place in places]
    assert (np.diff(at) > -1).all()
    assert at[-1] - at[0] > 15


@pytest.mark.parametrize("video", PLAIN)
def test_it_keeps_clear_of_the_wall(scenes: dict[str, Scene], video: str) -> None:
    assert min(from_wall(scenes[video])) > 0.9 * CLEARANCE


def test_drawn_ways_come_close_to_the_wall_look_aside_and_down_the_lumen(scenes: dict[str, Scene]) -> None:
    close, aside, far = [], [], []
    for video in DRAWN:
        scene = scenes[video]
        close.append(min(from_wall(scene)))
        line = scene.renderer.colon.centreline
        for pose in scene.poses:
            at = line.at[np.linalg.norm(line.points - pose[:3, 3], axis=1).argmin()]
            inwards = -line.frames(np.array([at]))[1][0]
            aside.append(np.degrees(np.arccos(np.clip(pose[:3, 2] @ inwards, -1, 1))))
            far.append(np.quantile(scene.renderer.cast(pose).points[:, 2], 0.95))
    assert min(close) < 6
    assert min(close) > 0
    assert max(aside) > 45
    assert min(aside) < 15
    assert max(far) > 70
    assert min(far) < 45

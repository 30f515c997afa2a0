"""What videos draw anew: each part alone, every video for itself, within what can be seen and measured."""

from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusals import refused

from col3d.data.datasets.octagon import octagon_mask
from col3d.data.datasets.videos import describe, seeded_name, seeded_videos
from col3d.phantom import PARTS, PhantomSettings, render_phantom
from col3d.phantom.appearance import LOOKS
from col3d.phantom.segments import SEGMENTS
from col3d.phantom.write import scene_of

pytestmark = pytest.mark.end_to_end

VIDEO = "cecum_t1_a_s3"
SETTINGS = PhantomSettings(size_hw=(54, 68), frames_per_video=2, videos=(VIDEO,))


def rendered(root: Path, *parts: str) -> dict[str, np.ndarray]:
    render_phantom(root, replace(SETTINGS, randomise=parts), workers=1, progress=False)
    names = ("0001_color.png", "0001_depth.tiff")
    return {name: cv2.imread(str(root / VIDEO / name), cv2.IMREAD_UNCHANGED) for name in names}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    return rendered(tmp_path_factory.mktemp("plain") / "phantom")


@pytest.mark.parametrize("part", ["tissue", "light", "sensor"])
def test_a_part_of_the_look_changes_colour_and_nothing_else(
    plain: dict[str, np.ndarray], tmp_path: Path, part: str
) -> None:
    found = rendered(tmp_path / "phantom", part)
    np.testing.assert_array_equal(found["0001_depth.tiff"], plain["0001_depth.tiff"])
    assert (found["0001_color.png"] != plain["0001_color.png"]).mean() > 0.3


def test_anatomy_changes_the_depth(plain: dict[str, np.ndarray], tmp_path: Path) -> None:
    found = rendered(tmp_path / "phantom", "anatomy")
    assert (found["0001_depth.tiff"] != plain["0001_depth.tiff"]).mean() > 0.5


def test_a_part_does_not_depend_on_which_others_are_drawn() -> None:
    settings = replace(SETTINGS, randomise=PARTS)
    both = scene_of(VIDEO, settings).renderer.look
    alone = scene_of(VIDEO, replace(settings, randomise=("light",))).renderer.look
    assert both.light == alone.light != LOOKS["1"].light
    assert alone.tissue == LOOKS["1"].tissue
    assert alone.sensor == LOOKS["1"].sensor


@pytest.mark.parametrize("part", ["tissue", "light", "sensor"])
def test_every_number_of_a_look_is_drawn(part: str) -> None:
    looks = [LOOKS["2"].varied((part,), lambda _, k=k: np.random.default_rng(k)) for k in range(12)]
    for field in fields(getattr(looks[0], part)):
        assert len({getattr(getattr(look, part), field.name) for look in looks}) > 3, field.name


@pytest.mark.parametrize("name", list(SEGMENTS))
def test_no_bend_is_so_tight_that_the_wall_crosses_itself(name: str) -> None:
    drawn = [SEGMENTS[name].varied(np.random.default_rng(seed)) for seed in range(300)]
    assert min(s.bend_length / (2 * np.pi * s.bend * s.radius) for s in (*drawn, SEGMENTS[name])) > 1.39
    assert len({s.bend for s in drawn}) > 200


def test_every_video_draws_for_itself() -> None:
    settings = replace(SETTINGS, randomise=PARTS)
    first, second = (scene_of(video, settings).renderer for video in ("cecum_t1_a_s3", "cecum_t1_a_s4"))
    assert first.look != second.look
    assert first.colon.segment.radius != second.colon.segment.radius
    same = scene_of("cecum_t1_a", replace(settings, seed=3, videos=("cecum_t1_a",))).renderer
    assert same.look == first.look


def test_looks_reach_what_can_be_seen(tmp_path: Path) -> None:
    """Each frame shows something: neither black nor white nor flat, and depth within what C3VD stores."""
    videos = tuple(seeded_videos(0, 21))
    settings = PhantomSettings(size_hw=(54, 68), frames_per_video=2, randomise=PARTS, videos=videos)
    render_phantom(tmp_path / "phantom", settings, workers=2, progress=False)
    inside = octagon_mask(settings.size_hw)[0].numpy()
    means = []
    for video in videos:
        color = cv2.imread(str(tmp_path / "phantom" / video / "0001_color.png"))[inside]
        depth = cv2.imread(str(tmp_path / "phantom" / video / "0001_depth.tiff"), cv2.IMREAD_UNCHANGED)
        means.append(color.mean())
        assert color.std() > 3
        assert (depth[inside] > 0).mean() > 0.999
        assert (depth[inside] == 65535).mean() < 0.5
    assert min(means) > 10
    assert np.ptp(means) > 60


def test_names_with_seeds() -> None:
    assert seeded_name("cecum_t1_a_s12", 0) == ("cecum_t1_a", 12)
    assert seeded_name("cecum_t1_a", 5) == ("cecum_t1_a", 5)
    assert seeded_name("other_s12", 5) == ("other_s12", 5)
    assert seeded_name("cecum_t1_a_s012", 5) == ("cecum_t1_a_s012", 5)
    names = seeded_videos(0, 43)
    assert len(set(names)) == 44
    assert names[:2] == ["cecum_t1_a_s0", "cecum_t1_b_s0"]
    assert names[22] == "cecum_t1_a_s1"
    assert seeded_videos(30, 32) == names[30:33]
    assert describe("trans_t4_b_s7") == describe("trans_t4_b") != ("", "")


def test_an_unknown_part_is_named() -> None:
    with refused(ValueError, None, "randomise", "'colour'"):
        PhantomSettings(randomise=("colour",))

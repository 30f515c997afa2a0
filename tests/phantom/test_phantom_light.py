"""From lamps to pixels: laws of light on the wall, of the film on it, and of the sensor."""

from dataclasses import replace

import numpy as np
import pytest

from col3d.data.datasets.octagon import octagon_mask
from col3d.phantom import PhantomSettings, phantom_camera
from col3d.phantom.appearance import LOOKS, Light, Sensor
from col3d.phantom.sensor import develop
from col3d.phantom.shading import Hits, Mucosa, Radiance
from col3d.phantom.write import Scene, scene_of

SETTINGS = PhantomSettings(size_hw=(54, 68), frames_per_video=2, videos=("trans_t2_a",))
AT_LENS = Light(lamps=((0.0, 0.0, 0.0),), powers=(1.0,), scatter=0.0)
PLAIN = Sensor(vignette=0.0, noise=0.0, jpeg=100, black=0.0, shoulder=1.0)
PIXEL = 0.02


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_of("trans_t2_a", SETTINGS)


def towards(hits: Hits, points: np.ndarray) -> Hits:
    """Points of a wall without texture that faces the lens."""
    at = np.asarray(points, np.float32)
    few, facing = hits.band(slice(len(at))), -at / np.linalg.norm(at, axis=1, keepdims=True)
    return replace(few, points=at, normals=facing.astype(np.float32), attributes=0 * few.attributes)


def radiance_of(scene: Scene, hits: Hits, light: Light, roughness: float) -> Radiance:
    mucosa = scene.renderer.mucosa
    smooth = Mucosa(
        scene.renderer.colon,
        replace(mucosa.tissue, roughness=roughness, bubbles=40),
        np.random.default_rng(0),
    )
    lit = np.ones((len(hits.points), len(light.lamps)), np.float32)
    return smooth.radiance(hits, light, lit, PIXEL)


@pytest.mark.parametrize("beam", [0.5, 1.0, 2.0])
def test_light_falls_with_the_square_of_the_distance_and_off_the_axis(scene: Scene, beam: float) -> None:
    tilt = 0.8
    points = [[0, 0, 10], [0, 0, 20], [0, 0, 40], [20 * np.sin(tilt), 0, 20 * np.cos(tilt)]]
    hits = towards(scene.renderer.cast(scene.poses[0]), points)
    diffuse = radiance_of(scene, hits, replace(AT_LENS, beam=beam), roughness=0.0).diffuse
    np.testing.assert_allclose(diffuse[:3] * np.array([100, 400, 1600]), 1.0, rtol=1e-5)
    np.testing.assert_allclose(diffuse[3] * 400, np.cos(tilt) ** beam, rtol=1e-5)


def test_two_lamps_add_up_and_a_shadow_takes_its_own_away(scene: Scene) -> None:
    hits, light = scene.renderer.cast(scene.poses[0]), LOOKS["2"].light
    mucosa, ones = scene.renderer.mucosa, np.ones((len(hits.points), 2), np.float32)
    both, left, right = (
        mucosa.radiance(hits, light, ones * np.array(shares, np.float32), PIXEL)
        for shares in ((1, 1), (1, 0), (0, 1))
    )
    np.testing.assert_allclose(left.diffuse + right.diffuse, both.diffuse, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(left.mirrored + right.mirrored, both.mirrored, rtol=1e-4, atol=1e-9)
    assert (left.diffuse != right.diffuse).mean() > 0.9


def test_highlights_belong_to_the_wall_and_do_not_turn_with_the_camera(scene: Scene) -> None:
    hits = scene.renderer.cast(scene.poses[0])
    cosine, sine = np.cos(0.7), np.sin(0.7)
    roll = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], np.float32)
    rolled = replace(
        hits, points=hits.points @ roll.T, normals=hits.normals @ roll.T, turn=hits.turn @ roll.T
    )
    first, second = (radiance_of(scene, each, AT_LENS, roughness=0.3) for each in (hits, rolled))
    np.testing.assert_allclose(first.diffuse, second.diffuse, rtol=1e-3, atol=1e-7)
    scale = first.mirrored.max()
    np.testing.assert_allclose(first.mirrored / scale, second.mirrored / scale, atol=1e-3)
    assert np.ptp(first.mirrored) > 0


def picture(light: np.ndarray, sensor: Sensor, seed: int = 0) -> np.ndarray:
    size = light.shape[:2]
    off_axis = phantom_camera(replace(SETTINGS, size_hw=size)).rays().numpy()[2]
    return develop(light, off_axis, octagon_mask(size)[0].numpy(), sensor, np.random.default_rng(seed))


@pytest.fixture
def light() -> np.ndarray:
    shown = octagon_mask((135, 169))[0].numpy()
    ramp = np.linspace(0.2, 1.0, 169, dtype=np.float32)[None, :, None]
    return np.where(shown[..., None], ramp, 0).astype(np.float32) * np.ones((1, 1, 3), np.float32)


def test_exposure_follows_the_light_and_what_is_metered(light: np.ndarray) -> None:
    plain = picture(light, PLAIN).astype(int)
    assert np.abs(picture(light * 7.0, PLAIN).astype(int) - plain).max() <= 1
    assert picture(light, replace(PLAIN, exposure=0.1)).mean() < plain.mean() - 20
    assert picture(light, replace(PLAIN, metered=0.3)).mean() > plain.mean() + 5
    assert picture(light, replace(PLAIN, gamma=3.0)).mean() > plain.mean() + 5


def test_the_rim_is_darker_by_the_vignette(light: np.ndarray) -> None:
    even = np.where(light > 0, np.float32(1), np.float32(0))
    dark = picture(even, replace(PLAIN, vignette=0.9)).astype(int)
    middle, rim = dark[67, 84].mean(), dark[67, 3].mean()
    assert rim < middle - 20
    assert abs(int(picture(even, PLAIN)[67, 84].mean()) - int(picture(even, PLAIN)[67, 3].mean())) <= 2


def test_noise_blur_sharpening_and_compression_change_detail(light: np.ndarray) -> None:
    stripes = light * (1 + 0.3 * np.sign(np.sin(np.arange(169) * 1.2)))[None, :, None].astype(np.float32)
    inside = (slice(40, 95), slice(40, 130))

    def detail(sensor: Sensor) -> float:
        return float(np.abs(np.diff(picture(stripes, sensor)[inside].astype(float), axis=1)).mean())

    plain = detail(PLAIN)
    assert detail(replace(PLAIN, blur=1.0)) < 0.8 * plain
    assert detail(replace(PLAIN, sharpening=1.0)) > 1.1 * plain
    noisy = replace(PLAIN, noise=0.05)
    assert (picture(light, noisy) != picture(light, noisy, seed=1))[inside].mean() > 0.5
    packed = picture(stripes, replace(PLAIN, jpeg=50))[inside].astype(int)
    assert np.abs(packed - picture(stripes, PLAIN)[inside].astype(int)).mean() > 0.5


def test_the_mark_lies_in_the_corner(light: np.ndarray) -> None:
    corner = (slice(125, None), slice(160, None))
    assert picture(light, PLAIN)[corner].max() > 150
    assert picture(light, replace(PLAIN, icon_level=90))[corner].max() < 110
    assert picture(light, replace(PLAIN, icon_level=0))[corner].max() < 40

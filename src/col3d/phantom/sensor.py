"""Camera model: softens a frame's light by the tissue, and applies exposure, tone curve, sharpening, JPEG."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from col3d.phantom.appearance import Look, Sensor
from col3d.phantom.shading import Radiance

SPREAD = (1.0, 0.6, 0.4)
"""Weights of red, green and blue in the light that travels under the surface."""
NEAR = 15.0
"""Distance in mm for which the softness of tissue is converted to pixels."""
WIDTH = 169
"""Width in pixels of a frame at an eighth of C3VD's resolution, for which blur is given."""
ICON = (0.016, 0.019)
"""Size of the mark in the lower right corner, relative to the width and height of a frame."""

Picture = Float32[np.ndarray, "h w 3"]
Shown = Bool[np.ndarray, "h w"]


def light_of(
    seen: Radiance,
    distance: Float32[np.ndarray, " n"],
    shown: Shown,
    look: Look,
    pixel: float,
) -> Picture:
    """Compute the linear light of a frame; light that travels under the surface softens the shading.

    Args:
        seen: light that reaches the lens, for each shown pixel.
        distance: distance of those pixels in mm.
        shown: mask of the octagon.
        look: tissue and light.
        pixel: angle between neighbouring pixels in radians.
    """
    diffuse = _on_grid(seen.diffuse, shown)
    sigma = look.tissue.softness / (pixel * NEAR)
    wandering = diffuse
    if sigma > 0.3:
        weight = np.maximum(cv2.GaussianBlur(shown.astype(np.float32), (0, 0), sigma), 1e-3)
        wandering = cv2.GaussianBlur(diffuse, (0, 0), sigma) / weight
    part = np.clip(NEAR / distance, 0, 1)[:, None] * np.asarray(SPREAD, np.float32)
    even, soft = seen.diffuse[:, None], wandering[shown][:, None]
    reached = even + part * (soft - even)
    wall = seen.albedo * (reached + seen.scattered[:, None] * seen.albedo)
    return _on_grid(wall + seen.mirrored[:, None], shown)


def develop(
    light: Picture,
    off_axis: Float32[np.ndarray, "h w"],
    shown: Shown,
    sensor: Sensor,
    random: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """Develop a frame: vignette, metered exposure, tone curve, gamma, blur, sharpening, noise, compression.

    Args:
        light: linear light, zero outside the octagon.
        off_axis: cosine of each pixel's angle to the optical axis.
        shown: mask of the octagon.
        sensor: parameters of the sensor.
        random: source of the noise.
    """
    light = light * (1 - sensor.vignette + sensor.vignette * off_axis)[..., None]
    metered = np.quantile(light[shown].mean(axis=-1), sensor.metered)
    gain = sensor.exposure / max(float(metered), 1e-12)
    light *= gain * np.asarray(sensor.white, np.float32)
    bent = np.float32(sensor.shoulder) * (1 - np.exp(-light)) + np.float32(1 - sensor.shoulder) * light
    values = np.clip(bent, 0, 1) ** np.float32(1 / sensor.gamma)
    values = np.float32(sensor.black) + np.float32(1 - sensor.black) * values
    scale = light.shape[1] / WIDTH
    if sensor.blur:
        values = cv2.GaussianBlur(values, (0, 0), max(sensor.blur * scale, 0.2))
    if sensor.sharpening:
        values += np.float32(sensor.sharpening) * (values - cv2.GaussianBlur(values, (0, 0), 1.2 * scale))
    values += np.float32(sensor.noise) * random.standard_normal(values.shape, np.float32)
    outside = random.integers(0, sensor.surround + 1, (*shown.shape, 1), np.uint8)
    pixels = np.where(shown[..., None], np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8), outside)
    _mark(pixels, sensor)
    return _compressed(pixels, sensor.jpeg)


def _mark(pixels: UInt8[np.ndarray, "h w 3"], sensor: Sensor) -> None:
    """Draw the small mark that the endoscope's processor adds to the corner."""
    (height, width), (x, y), (wide, high) = pixels.shape[:2], sensor.icon, ICON
    left, right = (round((x + side * wide / 2) * width) for side in (-1, 1))
    top, bottom = (round((y + side * high / 2) * height) for side in (-1, 1))
    cv2.rectangle(
        pixels, (left, top), (right, bottom), (sensor.icon_level,) * 3, max(1, round(0.003 * width))
    )


def _compressed(pixels: UInt8[np.ndarray, "h w 3"], quality: int) -> UInt8[np.ndarray, "h w 3"]:
    coded, stream = cv2.imencode(
        ".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, quality)
    )
    read = cv2.imdecode(stream, cv2.IMREAD_COLOR)
    assert coded
    assert read is not None
    return cv2.cvtColor(read, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def _on_grid(values: np.ndarray, shown: Shown) -> np.ndarray:
    grid = np.zeros((*shown.shape, *values.shape[1:]), np.float32)
    grid[shown] = values
    return grid

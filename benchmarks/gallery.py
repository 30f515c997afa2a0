"""A picture of the phantom: every modality of one frame, and what videos draw anew.

python -m benchmarks.gallery docs/phantom.png
"""

import argparse
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from col3d.data.datasets.videos import seeded_videos
from col3d.phantom import PARTS, PhantomSettings
from col3d.phantom.render import FULL_CODE, MAX_FLOW, Frame
from col3d.phantom.write import scene_of

mpl.use("agg")
from matplotlib import pyplot as plt

SIZE = (270, 338)
VIDEO, FRAMES, NUMBER = "trans_t3_b", 60, 20
"""Of the modalities; so many frames that the motion between two of them is small."""
DRAWN = (0, 3, 6, 25, 30, 35, 40, 48, 57, 66, 75, 84)
"""Numbers of the colons below."""
COLUMNS = 6


def frame_of(video: str, frames: int, number: int, parts: tuple[str, ...]) -> Frame:
    """One frame of a video."""
    scene = scene_of(video, PhantomSettings(SIZE, frames, randomise=parts, videos=(video,)))
    previous = scene.poses[number - 1] if number else None
    return scene.renderer.frame(scene.poses[number], previous, scene.random(number))[0]


def shown_flow(frame: Frame) -> np.ndarray:
    """Direction as hue, length as brightness, white where it is unknown."""
    assert frame.flow is not None
    known = np.asarray(frame.flow.any(axis=-1))
    motion = frame.flow[..., :2].astype(float) / FULL_CODE * 2 * MAX_FLOW - MAX_FLOW
    length, angle = cv2.cartToPolar(motion[..., 0], motion[..., 1], angleInDegrees=True)
    strength = 255 * np.clip(length / np.quantile(length[known], 0.98), 0, 1)
    hsv = np.stack([angle / 2, np.full_like(angle, 200), strength], axis=-1).astype(np.uint8)
    return np.where(known[..., None], cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), 255)


def main() -> None:
    """Render and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    frame = frame_of(VIDEO, FRAMES, NUMBER, ())
    depth = np.where(frame.depth > 0, frame.depth / FULL_CODE, np.nan)
    panels: dict[str, np.ndarray] = {
        "colour": frame.color,
        "depth": plt.get_cmap("turbo")(depth),
        "normals": frame.normals.astype(float) / FULL_CODE,
        "flow": shown_flow(frame),
        "occlusion": np.repeat(frame.occlusion[..., None], 3, axis=-1),
    }
    rows = 1 + len(DRAWN) // COLUMNS
    figure = plt.figure(figsize=(12, 1.7 * rows + 0.3), layout="constrained")
    top, below = np.asarray(figure.subfigures(2, 1, height_ratios=(1.25, rows - 1)), dtype=object)
    for ax, (name, image) in zip(top.subplots(1, len(panels)), panels.items(), strict=True):
        ax.imshow(image)
        ax.set_title(name, fontsize=10)
        ax.axis("off")
    for ax, number in zip(below.subplots(rows - 1, COLUMNS).ravel(), DRAWN, strict=True):
        ax.imshow(frame_of(seeded_videos(number, number)[0], 4, 2, PARTS).color)
        ax.axis("off")
    figure.savefig(given.out, dpi=75)


if __name__ == "__main__":
    main()

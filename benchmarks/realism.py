"""Does the phantom look like the real thing, in numbers? Its frames beside real ones in C3VD's format.

    python -m benchmarks.realism /path/to/C3VD cecum_t1_a --phantom data/phantom_135x169_12_0_randomised

Draws a line for every real frame, and for the phantom's the band that holds nine tenths of them: how often
each brightness occurs, how brightness falls with depth, the colours, and the spectrum of detail. `--sheet`
writes real and phantom frames side by side as well; that picture holds the data set's
pixels, so keep it where its licence allows.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.sized import Resized
from col3d.errors import DataError
from col3d.phantom import PhantomSettings, phantom_camera

mpl.use("agg")
from matplotlib import pyplot as plt

SIZE = (128, 160)
BRIGHTNESS = np.linspace(0, 1, 33)
DEPTHS = np.array([5, 8, 12, 16, 20, 25, 30, 40, 50, 60, 75, 95], float)
BURNT = 0.97
"""Least channel of a pixel that counts as burnt out."""


@dataclass(frozen=True)
class Look:
    """What is measured of one frame."""

    brightness: np.ndarray
    """Share of pixels in each bin of brightness."""
    fall: np.ndarray
    """Median brightness at each depth over that of the frame; NaN where few pixels are."""
    colour: np.ndarray
    """Red over green and blue over green, of the means."""
    burnt: float
    spectrum: np.ndarray
    """Power of log brightness by spatial frequency, in cycles per image height."""


def look(image: np.ndarray, depth: np.ndarray, counts: np.ndarray) -> Look:
    """Measure a frame.

    Args:
        image: (h, w, 3) in [0, 1].
        depth: (h, w) in mm.
        counts: (h, w) where depth is known.
    """
    shown = octagon_mask(SIZE)[0].numpy()
    grey = image.mean(axis=-1)
    histogram = np.histogram(grey[shown], BRIGHTNESS)[0] / shown.sum()
    bins = np.digitize(depth, DEPTHS)
    middle = np.median(grey[shown])
    fall = np.full(len(DEPTHS) - 1, np.nan)
    for place in range(1, len(DEPTHS)):
        chosen = counts & (bins == place)
        if chosen.sum() > 100:
            fall[place - 1] = np.median(grey[chosen]) / middle
    means = image[shown].mean(axis=0)
    burnt = float((image[shown].min(axis=-1) > BURNT).mean())
    return Look(histogram, fall, means[[0, 2]] / means[1], burnt, _spectrum(grey))


def _spectrum(grey: np.ndarray) -> np.ndarray:
    """Of the largest square that the octagon holds in the middle."""
    side = 96
    top, left = (SIZE[0] - side) // 2, (SIZE[1] - side) // 2
    part = np.log(np.maximum(grey[top : top + side, left : left + side], 0.02))
    window = np.hanning(side)[:, None] * np.hanning(side)[None]
    power = np.abs(np.fft.fftshift(np.fft.fft2((part - part.mean()) * window))) ** 2
    v, u = np.indices(power.shape) - side // 2
    ring = np.hypot(u, v).astype(int)
    return np.bincount(ring.ravel(), power.ravel())[1 : side // 2] / np.bincount(ring.ravel())[1 : side // 2]


def looks(frames: Resized, chosen: Sequence[int]) -> tuple[list[Look], list[np.ndarray]]:
    """Of these frames, and their images in 8 bits."""
    found, images = [], []
    for index in chosen:
        item = frames[index]
        image = item["image"].permute(1, 2, 0).numpy()
        found.append(look(image, item["depth"][0].numpy(), item["mask"][0].numpy()))
        images.append((image * 255).round().astype(np.uint8))
    return found, images


def draw(real: Sequence[Look], phantom: Sequence[Look], path: Path) -> None:
    """Four panels; lines are real frames, the band holds nine tenths of the phantom's."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
    middles = (BRIGHTNESS[1:] + BRIGHTNESS[:-1]) / 2
    depths = (DEPTHS[1:] + DEPTHS[:-1]) / 2
    cycles = np.arange(1, len(real[0].spectrum) + 1)
    panels = (
        (axes[0, 0], middles, "brightness", "share of the pixels", "brightness"),
        (axes[0, 1], depths, "depth, mm", "brightness over the frame's median", "fall"),
        (axes[1, 1], cycles, "cycles in the middle 3/4 of the height", "power of log brightness", "spectrum"),
    )
    for ax, x, across, up, name in panels:
        values = np.stack([getattr(one, name) for one in phantom])
        low, median, high = np.nanpercentile(values, [5, 50, 95], axis=0)
        ax.fill_between(x, low, high, color="#9ec5e8", label="phantom, 5 to 95 %")
        ax.plot(x, median, color="#2b6ca3", label="phantom, median")
        for k, one in enumerate(real):
            ax.plot(x, getattr(one, name), color="#c2452d", lw=1, label=None if k else "real frames")
        ax.set(xlabel=across, ylabel=up)
    axes[0, 0].legend(frameon=False)
    axes[1, 1].set(xscale="log", yscale="log")
    for group, color, size in ((phantom, "#2b6ca3", 8), (real, "#c2452d", 28)):
        colours = np.stack([one.colour for one in group])
        axes[1, 0].scatter(colours[:, 0], colours[:, 1], s=size, color=color)
    axes[1, 0].set(xlabel="red over green", ylabel="blue over green")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, draw, and print what lies outside."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path, help="folder of the folders of real videos")
    parser.add_argument("videos", nargs="+")
    parser.add_argument("--phantom", type=Path, required=True, help="folder of a phantom of 135 x 169 pixels")
    parser.add_argument("--frames", type=int, default=400, help="of the phantom")
    parser.add_argument("--out", type=Path, default=Path("realism.png"))
    parser.add_argument("--sheet", type=Path, help="write frames side by side")
    given = parser.parse_args()
    settings = PhantomSettings(size_hw=(135, 169))
    try:
        names = sorted(path.name for path in given.phantom.glob("[!.]*") if path.is_dir())
        real = Resized(C3VD(given.root, given.videos, normals="none"), SIZE)
        drawn = Resized(C3VD(given.phantom, names, normals="none", camera=phantom_camera(settings)), SIZE)
    except (DataError, OSError) as error:
        sys.exit(str(error))
    there, there_images = looks(real, range(len(real)))
    chosen = np.random.default_rng(0).permutation(len(drawn))[: given.frames].tolist()
    here, here_images = looks(drawn, chosen)
    draw(there, here, given.out)
    for name, values in (("real", there), ("phantom", here)):
        low, middle, high = np.percentile([100 * one.burnt for one in values], [5, 50, 95])
        print(f"{name}: {len(values)} frames, burnt out {low:.2f} to {high:.2f} %, median {middle:.2f} %")
    if given.sheet:
        rows = [
            np.hstack(images[:6]) for images in (there_images, here_images, here_images[6:], here_images[12:])
        ]
        width = min(row.shape[1] for row in rows)
        sheet = np.vstack([row[:, :width] for row in rows])
        cv2.imwrite(str(given.sheet), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))


if __name__ == "__main__":
    main()

"""Which lens made a data set's truth: depth carried by the poses, and normals, through each reading of it.

    python -m benchmarks.lens /path/to/C3VD cecum_t1_a --every 60

Prints tables in Markdown. The first is of all ordered pairs of every n-th frame, by how many frames they are
apart: the median over pairs of the median |z - depth there| in mm, and the range over pairs; points are every
hundredth pixel that lies on a smooth surface which both frames see, or in the last column every one that
falls into the other frame. The second, where the video stores normals, is their median angle to those of the
depth.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path

import numpy as np
import torch

from col3d.data.checks.lens import readings_of
from col3d.data.checks.reproject import reproject, surface_error
from col3d.data.checks.salvage import read_whole
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.frame_set import everywhere
from col3d.data.datasets.release import disagreement
from col3d.errors import DataError
from col3d.geometry import Camera, PinholeCamera

Pair = tuple[int, int]


def carried(frames: C3VD, every: int) -> dict[Pair, dict[str, float]]:
    """By pair of frames, the error of each reading, and of the lens in use over all points."""
    chosen = [frame for frame in frames.frames if frame.number % every == 0]
    poses = frames.poses(chosen[0].video).numpy()
    depths = {frame.number: frames.decoded_depth(read_whole(frame.files["depth"])) for frame in chosen}
    readings = readings_of(frames)
    found = {}
    for one, other in permutations(depths, 2):
        pair, both = (depths[one], depths[other]), (poses[one], poses[other])
        errors = {name: surface_error(*pair, both, camera) for name, camera in readings.items()}
        errors["all points"] = reproject(*pair, both, frames.camera, other).median
        found[one, other] = errors
    return found


def print_carried(errors: Mapping[Pair, Mapping[str, float]]) -> None:
    """A row for each distance, and one for all pairs."""
    names = list(next(iter(errors.values())))
    print(f"| frames apart | pairs | {' | '.join(names)} |\n|---|---|{'---|' * len(names)}")
    distances = sorted({abs(one - other) for one, other in errors})
    for label, chosen in [*((str(d), {d}) for d in distances), ("all", set(distances))]:
        rows = [row for (one, other), row in errors.items() if abs(one - other) in chosen]
        cells = [_range([row[name] for row in rows]) for name in names]
        print(f"| {label} | {len(rows)} | {' | '.join(cells)} |")


def _range(values: Sequence[float]) -> str:
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return "-"
    return f"{np.median(known):.5f} ({min(known):.5f} to {max(known):.5f})"


def angles(frames: C3VD) -> dict[str, float]:
    """Median over frames of the median angle in degrees of stored normals to those of the depth."""
    cameras: dict[str, Camera] = readings_of(frames)
    cameras["pinhole of published code"] = PinholeCamera.c3vd().resized(frames.camera.size_hw)
    found: dict[str, list[float]] = {name: [] for name in cameras}
    for frame in frames.frames:
        depth, mask = frames.depth_and_mask(frame, everywhere)
        for name, camera in cameras.items():
            by_release = disagreement(frames.normal_codes(frame), depth, mask, camera)
            found[name].append(by_release[frames.releases[frame.video]])
    return {name: float(np.median(values)) for name, values in found.items()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path, help="folder of the folders of videos, in C3VD's format")
    parser.add_argument("video", help="its name")
    parser.add_argument("--every", type=int, default=60, help="frames whose number is a multiple of this")
    given = parser.parse_args()
    torch.set_num_threads(1)
    try:
        folder = C3VD(given.root, []).folders[given.video]
        stored = bool(C3VD.kinds["normals"].find(folder))
        frames = C3VD(given.root, [given.video], normals="stored" if stored else "none")
        if (folder / "pose.txt").is_file():
            print_carried(carried(frames, given.every))
    except (DataError, KeyError) as error:
        sys.exit(f"{given.root}: {error}")
    if stored:
        print("\n| normals of the depth through | median angle to the stored ones, degrees |\n|---|---|")
        for name, angle in angles(frames).items():
            print(f"| {name} | {angle:.2f} |")


if __name__ == "__main__":
    main()

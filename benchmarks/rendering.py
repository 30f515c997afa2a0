"""How fast the phantom is rendered, with every modality and written to disk, where the time goes, and memory.

python -m benchmarks.rendering
"""

import argparse
import cProfile
import os
import pstats
import resource
import tempfile
import time
from pathlib import Path

from col3d.phantom import PhantomSettings, render_phantom
from col3d.phantom.write import render_video

SIZES = {"a quarter, 270 x 338": ((270, 338), 100), "full, 1080 x 1350": ((1080, 1350), 16)}
"""Sizes, and frames of each of two videos."""
VIDEOS = ("trans_t2_a", "cecum_t1_a")
PARTS = {
    "growing the colon and its surface": "scene_of",
    "casting the camera's rays": "cast",
    "shadows of the lamps": "_lit",
    "shading": "radiance",
    "light under the surface": "light_of",
    "occlusion": "hides_another",
    "flow": "_flow",
    "sensor": "develop",
    "writing": "_write_frame",
}
"""What is timed, by the name of its function."""


def frames_a_second(size_hw: tuple[int, int], frames: int) -> float:
    """By as many processes as there are cores; their start, the colons' growth and writing are included."""
    settings = PhantomSettings(size_hw, frames, videos=VIDEOS)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        render_phantom(Path(folder) / "phantom", settings, progress=False)
        return len(VIDEOS) * frames / (time.perf_counter() - start)


def profile(size_hw: tuple[int, int], frames: int) -> tuple[dict[str, float], list[float]]:
    """Seconds a frame of each part in one process, and its memory in MB after every frame."""
    memory: list[float] = []
    settings = PhantomSettings(size_hw, frames, videos=VIDEOS[:1])
    measured = cProfile.Profile()
    with tempfile.TemporaryDirectory() as folder:
        measured.runcall(render_video, Path(folder), VIDEOS[0], settings, lambda: memory.append(_resident()))
    entries = getattr(pstats.Stats(measured), "stats")  # noqa: B009 - not in its type stubs
    spent = {name: row[3] for (file, _, name), row in entries.items() if "phantom" in file}
    return {part: spent[name] / frames for part, name in PARTS.items()}, memory


def _resident() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main() -> None:
    """Print tables in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    rates = {name: frames_a_second(size, frames) for name, (size, frames) in SIZES.items()}
    found = {name: profile(size, frames) for name, (size, frames) in SIZES.items()}
    print(f"| {os.cpu_count()} processes | " + " | ".join(SIZES) + " |\n|---|" + "---|" * len(SIZES))
    print("| frames a second | " + " | ".join(f"{rate:.2f}" for rate in rates.values()) + " |")
    for part in PARTS:
        cells = (f"{1000 * seconds[part]:.0f} ms" for seconds, _ in found.values())
        print(f"| {part}, one process | " + " | ".join(cells) + " |")
    for label, pick in (("first", 1), ("last", -1)):
        cells = (f"{memory[pick]:.0f} MB" for _, memory in found.values())
        print(f"| memory after the {label} frames | " + " | ".join(cells) + " |")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(f"\nlargest process: {peak:.0f} MB")


if __name__ == "__main__":
    main()

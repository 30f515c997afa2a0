"""Report of a data verification: a table and every fault on screen, and one HTML page with pictures."""

import base64
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from col3d.io.atomic import write_whole
from col3d.reports.places import without_places
from col3d.reports.screen import plain_console
from col3d.reports.summary import LOG_WIDTH
from col3d.reports.templating import filled

HEADINGS = (
    "video",
    "frames",
    "depth mm",
    "invalid %",
    "release",
    "normals",
    "deg",
    "reproj. mm",
    "lens mm",
    "flow px",
    "twice",
    "faults",
)
TEXTS, UNBROKEN = ("video", "release", "normals"), ("video", "normals")
DEPTH_COLOURS = "viridis"
GREY = 204
GAP = 4
MOST_LINES = 10
"""Findings of one rule in one video that are listed one by one."""
QUALITY = 82


@dataclass(frozen=True)
class Picture:
    """One frame as the page shows it; a map that does not exist is None.

    Attributes:
        lines: what is wrong with it; empty for a healthy frame.
        image: (h, w, 3) in 8 bits.
        depth: (h, w) in mm, NaN where it does not count.
        normals: (h, w, 3) in 8 bits, as stored.
    """

    video: str
    frame: int
    lines: Sequence[str]
    image: np.ndarray | None
    depth: np.ndarray | None
    normals: np.ndarray | None

    @property
    def depth_range(self) -> str:
        """Least and largest depth, as text."""
        known = np.empty(0) if self.depth is None else self.depth[np.isfinite(self.depth)]
        return f"depth {known.min():.1f} to {known.max():.1f} mm" if known.size else "no depth"


def print_verification(facts: Mapping[str, Any], console: Console | None = None) -> None:
    """Print a row for each video, the ranking of conventions, and every fault in a line.

    Args:
        facts: content of `verify.json`.
        console: where to print; the screen when absent.
    """
    console = console or plain_console()
    if not console.is_terminal:
        console.width = max(console.width, LOG_WIDTH)
    table = Table(title=_title(facts), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in HEADINGS:
        text, whole = heading in TEXTS, heading in UNBROKEN
        table.add_column(heading, justify="left" if text else "right", no_wrap=whole, overflow="fold")
    for video in facts["videos"]:
        table.add_row(*cells(video), style="bold" if video["faults"] else None)
    console.print(table)
    if facts["ranking"]:
        lines = ["best conventions of the normals:", *ranking_lines(facts), ""]
        console.print("\n".join(lines), markup=False, highlight=False)
    if facts["lens"]:
        lines = ["depth carried from frame to frame by the poses:", *lens_lines(facts), ""]
        console.print("\n".join(lines), markup=False, highlight=False)
    for line in finding_lines(facts["findings"]):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    speed = facts["frames"] / max(facts["seconds"], 1e-3)
    console.print(
        f"{counted(facts['faults'], 'fault')} and {counted(facts['notes'], 'note')}; "
        f"{counted(facts['frames'], 'frame')} of {counted(len(facts['videos']), 'video')}, "
        f"{facts['in_full']} decoded, in {facts['seconds']:.0f} s ({speed:.1f} a second)",
        style="bold",
        highlight=False,
    )


def counted(count: int, word: str) -> str:
    """A number and its noun, with a plural s unless the number is 1."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def _title(facts: Mapping[str, Any]) -> str:
    height, width = facts["videos"][0]["size"]
    return f"{facts['data']} in {facts['root']}, {height} x {width}"


def cells(video: Mapping[str, Any]) -> list[str]:
    """Cells of one video's row of the table."""
    expected = "" if video["expected"] is None else f"/{video['expected']}"
    pinhole = " pinhole" if video["camera"] == "pinhole" else ""
    return [
        video["video"],
        f"{video['frames']}{expected}",
        f"{_number(video['low'], 1)}-{_number(video['high'], 1)}" if _is_number(video["low"]) else "-",
        _number(100 * video["unknown"] if _is_number(video["unknown"]) else None, 1),
        video["release"] or "-",
        f"{video['normals']}{pinhole}" if video["normals"] else "none",
        _number(video["angle"], 2),
        _number(video["reprojection"], 4) if video["poses"] else "no poses",
        _number(next(iter(video["lens"].values()), None), 5),
        _number(video["flow"], 3),
        str(video["duplicates"]),
        str(video["faults"]),
    ]


def ranking_lines(facts: Mapping[str, Any]) -> list[str]:
    """Lines on the best conventions over all frames."""
    return [
        f"{row['angle']:6.2f} deg  {row['normals']} of the {row['camera']}"
        + (f", release {row['release']}" if row["release"] else "")
        for row in facts["ranking"]
    ]


def lens_lines(facts: Mapping[str, Any]) -> list[str]:
    """Lines on the readings of the lens, the best first."""
    return [
        f"{row['error']:8.5f} mm  stretch matrix {row['reading']}{', in use' if row['own'] else ''}"
        for row in facts["lens"]
    ]


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Lines of faults, then of notes; of many of a kind in a video the first ones and their number."""

    def kind(finding: Mapping[str, Any]) -> tuple[bool, str, str]:
        return not finding["fault"], finding["video"], finding["rule"]

    for (note, _, rule), group in groupby(sorted(findings, key=kind), kind):
        similar = list(group)
        word = "note" if note else "fault"
        yield from (f"{word}: {finding['text']}" for finding in similar[:MOST_LINES])
        if len(similar) > MOST_LINES:
            yield f"{word}: ... and {len(similar) - MOST_LINES} more of this kind ({rule}), in verify.json"


def write_page(path: Path, facts: Mapping[str, Any], pictures: Sequence[Picture]) -> None:
    """Write one self-contained HTML page.

    Args:
        path: page to write.
        facts: content of `verify.json`.
        pictures: frames with faults, and healthy ones.
    """
    facts = without_places(facts)
    shown = {
        "facts": facts,
        "title": _title(facts),
        "headings": HEADINGS,
        "texts": TEXTS,
        "lines": list(finding_lines(facts["findings"])),
        "broken": [picture for picture in pictures if picture.lines],
        "healthy": [picture for picture in pictures if not picture.lines],
    }
    text = filled("verify.html", shown, cells=cells, strip=strip, without_places=without_places)
    write_whole(path, text)


def strip(picture: Picture) -> str:
    """Image, depth and normals side by side, as a JPEG data URI."""
    maps = [picture.image, None if picture.depth is None else _depth_colours(picture.depth), picture.normals]
    size = next((values.shape[:2] for values in maps if values is not None), (80, 100))
    tiles = [_tile(values, size) for values in maps]
    gap = np.full((size[0], GAP, 3), 255, np.uint8)
    whole = np.concatenate([tiles[0], gap, tiles[1], gap, tiles[2]], axis=1)
    content = io.BytesIO()
    Image.fromarray(whole).save(content, "JPEG", quality=QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(content.getvalue()).decode('ascii')}"


def _tile(values: np.ndarray | None, size: tuple[int, ...]) -> np.ndarray:
    """A map fitted to the size; a grey tile with the word `none` where there is no map."""
    if values is not None and values.shape[:2] == size:
        return values
    if values is not None:
        return np.asarray(Image.fromarray(values).resize((size[1], size[0])))
    empty = Image.new("RGB", (size[1], size[0]), (GREY, GREY, GREY))
    draw = ImageDraw.Draw(empty)
    draw.text((size[1] / 2, size[0] / 2), "none", fill=(90, 90, 90), anchor="mm")
    return np.asarray(empty)


def _depth_colours(depth: np.ndarray) -> np.ndarray:
    """Near to far over the frame's own range, grey where nothing is known."""
    from matplotlib import colormaps

    known = np.isfinite(depth)
    low, high = (depth[known].min(), depth[known].max()) if known.any() else (0.0, 1.0)
    scaled = (np.where(known, depth, low) - low) / max(high - low, 1e-6)
    colours = (colormaps[DEPTH_COLOURS](scaled)[..., :3] * 255).round().astype(np.uint8)
    return np.where(known[..., None], colours, np.uint8(GREY))


def _is_number(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _number(value: float | None, decimals: int) -> str:
    return f"{value:.{decimals}f}" if value is not None and math.isfinite(value) else "-"

"""The page and the table of a verification, from plain values."""

import base64
import io
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from col3d.reports.verification import (
    GREY,
    HEADINGS,
    MOST_LINES,
    Picture,
    cells,
    finding_lines,
    print_verification,
    strip,
    write_page,
)


def finding(number: int, rule: str = "file", fault: bool = True) -> dict[str, Any]:
    return {"rule": rule, "text": f"{rule} {number}", "video": "v", "frame": number, "fault": fault}


def video(**others: Any) -> dict[str, Any]:
    return {
        "video": "cecum_t1_a",
        "folder": "/data/cecum_t1_a",
        "size": (1080, 1350),
        "frames": 275,
        "expected": 276,
        "in_full": 275,
        "low": 3.21,
        "high": 99.96,
        "unknown": 0.0712,
        "outside": 0.0004,
        "release": "current",
        "normals": "(x, y, z)",
        "camera": "lens",
        "angle": 1.987,
        "poses": True,
        "pairs": 274,
        "reprojection": 0.01234,
        "lens": {"[[c, e], [d, 1]]": 0.000491, "identity": 0.0129},
        "lens_pairs": 18,
        "flow": 0.0012,
        "duplicates": 2,
        "faults": 1,
        **others,
    }


def facts(**others: Any) -> dict[str, Any]:
    ranking = [{"normals": "(x, y, z)", "camera": "lens", "release": "current", "angle": 1.987}]
    return {
        "data": "c3vd",
        "root": "/data/<C3VD>",
        "fast": False,
        "frames": 275,
        "in_full": 275,
        "faults": 1,
        "notes": 0,
        "seconds": 25.0,
        "videos": [video()],
        "ranking": ranking,
        "lens": [
            {"reading": "[[c, e], [d, 1]]", "error": 0.000491, "own": True, "pairs": 18},
            {"reading": "identity", "error": 0.0129, "own": False, "pairs": 18},
        ],
        "findings": [finding(3)],
        **others,
    }


def screen(content: dict[str, Any]) -> str:
    console = Console(file=io.StringIO(), width=120)
    print_verification(content, console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_row() -> None:
    expected = "cecum_t1_a 275/276 3.2-100.0 7.1 current (x, y, z) 1.99 0.0123 0.00049 0.001 2 1"
    assert " ".join(cells(video())) == expected
    assert len(cells(video())) == len(HEADINGS)


@pytest.mark.parametrize("unknown", [None, float("nan")])
def test_a_row_of_what_was_not_to_be_had(unknown: float | None) -> None:
    row: dict[str, Any] = dict.fromkeys(("low", "high", "unknown", "angle", "reprojection", "flow"), unknown)
    row["lens"] = {}
    found = cells(video(**row, expected=None, release="", normals="", camera="", poses=False))
    assert found[1:10] == ["275", "-", "-", "-", "none", "-", "no poses", "-", "-"]
    assert "(x, y, z) pinhole" in cells(video(camera="pinhole"))


def test_the_screen_names_every_fault() -> None:
    text = screen(facts(findings=[finding(n) for n in range(3)] + [finding(9, "poses", fault=False)]))
    assert text.count("fault: file") == 3
    assert text.index("fault: file 2") < text.index("note: poses 9")
    assert "1.99 deg  (x, y, z) of the lens, release current" in text
    assert (
        " 0.00049 mm  stretch matrix [[c, e], [d, 1]], in use\n 0.01290 mm  stretch matrix identity" in text
    )
    assert "c3vd in /data/<C3VD>, 1080 x 1350" in text
    assert "1 fault and 0 notes; 275 frames of 1 video, 275 decoded, in 25 s (11.0 a second)" in text
    assert max(map(len, text.splitlines())) <= 120


def test_many_of_a_kind_are_counted() -> None:
    many = [finding(n) for n in range(MOST_LINES + 7)] + [finding(0, "depth")]
    lines = list(finding_lines(many))
    assert len(lines) == MOST_LINES + 2
    assert lines[-1] == "fault: ... and 7 more of this kind (file), in verify.json"
    assert "fault: depth 0" in lines


def picture(**others: Any) -> Picture:
    depth = np.linspace(5, 50, 80 * 100, dtype=np.float32).reshape(80, 100)
    depth[:20] = np.nan
    image, normals = np.full((80, 100, 3), 200, np.uint8), np.full((80, 100, 3), 90, np.uint8)
    maps = {"image": image, "depth": depth, "normals": normals, **others}
    return Picture("cecum_t1_a", 7, ["<b>cut off</b>"], **maps)


def pixels_of(found: str) -> np.ndarray:
    kind, content = found.split(",")
    assert kind == "data:image/jpeg;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(content)))).astype(int)


def test_a_strip_has_three_maps() -> None:
    found = pixels_of(strip(picture()))
    assert found.shape == (80, 308, 3)
    assert abs(found[40, 50] - 200).max() < 8
    assert abs(found[5, 154] - GREY).max() < 8  # no depth there
    near, far = found[22, 110], found[78, 200]
    assert near[2] > near[0] > near[1]  # from violet
    assert far[0] > far[2] + 50  # to yellow
    assert abs(found[40, 258] - 90).max() < 8
    assert picture().depth_range == "depth 16.3 to 50.0 mm"


@pytest.mark.parametrize("missing", ["image", "depth", "normals"])
def test_a_map_that_is_missing_is_grey(missing: str) -> None:
    found = pixels_of(strip(picture(**{missing: None})))
    left = {"image": 0, "depth": 104, "normals": 208}[missing]
    assert abs(found[5, left + 20] - GREY).max() < 8
    assert found[30:50, left : left + 100].min() < 150  # and says so


def test_a_frame_of_which_nothing_is_left_and_one_of_several_sizes() -> None:
    assert pixels_of(strip(picture(image=None, depth=None, normals=None))).shape == (80, 308, 3)
    odd = picture(image=np.zeros((40, 100, 3), np.uint8))
    assert pixels_of(strip(odd)).shape == (40, 308, 3)
    assert picture(depth=np.full((80, 100), np.nan, np.float32)).depth_range == "no depth"


def test_the_page_needs_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "verify.html"
    healthy = Picture(
        "cecum_t1_a", 9, [], *(getattr(picture(), name) for name in ("image", "depth", "normals"))
    )
    write_page(path, facts(), [picture(), healthy])
    page = path.read_text(encoding="utf-8")
    assert "c3vd in &lt;C3VD&gt;, 1080 x 1350" in page
    assert "&lt;b&gt;cut off&lt;/b&gt;" in page
    assert "<b>cut off</b>" not in page
    for link in re.findall(r'(?:src|href)="([^"]*)"', page):
        assert link.startswith("data:")
    assert page.count("<figure>") == 2
    assert page.index("Frames with faults") < page.index("One healthy frame")
    assert "1 fault</strong>" in page
    assert '<th scope="row">cecum_t1_a</th>' in page


def test_the_page_of_a_healthy_set(tmp_path: Path) -> None:
    path = tmp_path / "verify.html"
    row = video(faults=0, normals="")
    write_page(path, facts(faults=0, findings=[], ranking=[], fast=True, in_full=8, videos=[row]), [])
    page = path.read_text(encoding="utf-8")
    assert "No fault</strong>" in page
    assert "8 of them were decoded" in page
    for part in ("Findings", "Conventions of", "Frames with", "One healthy", 'class="bad"'):
        assert part not in page


def test_it_needs_no_torch() -> None:
    code = "import sys, col3d.reports.verification; assert not {'torch', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)

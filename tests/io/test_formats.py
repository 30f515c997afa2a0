"""Images and videos are opened as what their names promise, and as nothing else that a decoder may know."""

import ast
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from refusals import refused

from col3d.data.files.decode import read_whole
from col3d.data.files.image_files import check_header
from col3d.data.files.images import image_source, read_image
from col3d.errors import DataError
from col3d.inference.demo.uploads import read_clip, read_photo
from col3d.io.formats import open_video

PROJECT = Path(__file__).parents[2]
FOREIGN = (
    "EPS",
    "GIF",
    "PPM",
    "ICO",
    "TGA",
    "PCX",
    "SGI",
    "ICNS",
    "JPEG2000",
    "DDS",
    "PDF",
    "MSP",
    "IM",
)
LISTS = {
    "concat": "ffconcat version 1.0\nfile real.mp4\n",
    "m3u8": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nreal.mp4\n#EXT-X-ENDLIST\n",
    "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 9 RTP/AVP 26\n",
    "mpd": '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><Period>'
    '<AdaptationSet mimeType="video/mp4"><Representation id="1"><BaseURL>real.mp4</BaseURL></Representation>'
    "</AdaptationSet></Period></MPD>",
}
VIDEOS = {
    "avi": "MJPG",
    "mov": "mp4v",
    "mkv": "mp4v",
    "webm": "vp80",
    "mpg": "mpg1",
    "wmv": "WMV2",
    "m4v": "mp4v",
}


def calls(name: str) -> Iterator[tuple[str, ast.Call]]:
    """Every call of a function of that name in this project's programs, notebooks included."""
    for path in PROJECT.rglob("*.py"):
        if not {"tests", ".venv", "build"} & set(path.relative_to(PROJECT).parts):
            yield from calls_in(path, path.read_text(encoding="utf-8"), name)
    for path in (PROJECT / "notebooks").glob("*.ipynb"):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                code = "".join(line for line in cell["source"] if not line.startswith(("%", "!")))
                yield from calls_in(path, code, name)


def calls_in(path: Path, code: str, name: str) -> Iterator[tuple[str, ast.Call]]:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(name):
            yield f"{path.relative_to(PROJECT)}:{node.lineno}", node


def test_every_image_is_opened_with_its_formats() -> None:
    found = dict(calls("Image.open"))
    assert len(found) >= 7
    assert [
        place for place, call in found.items() if "formats" not in {word.arg for word in call.keywords}
    ] == []


def test_every_video_is_opened_in_one_place() -> None:
    assert {place.partition(":")[0] for place, _ in calls("VideoCapture")} == {"src/col3d/io/formats.py"}


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_format_that_nobody_asked_for_is_no_image(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    picture = Image.new("1" if kind == "MSP" else "RGB", (32, 24))
    picture.save(path, kind)
    with Image.open(path) if kind != "PDF" else picture:
        pass  # any other reader takes it
    for read in (read_image, read_photo, lambda path: check_header(path, (24, 32), None, None)):
        with refused(DataError, None, "a.png: ", "not a"):
            read(path)


def test_verification_opens_no_other_format(tmp_path: Path) -> None:
    path = tmp_path / "a.tiff"
    Image.new("RGB", (32, 24)).save(path, "EPS")
    with refused(DataError, path, "decoded"):
        read_whole(path)


def write_video(path: Path, code: str = "mp4v") -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 25, (96, 64))
    for shade in range(0, 250, 50):
        writer.write(np.full((64, 96, 3), shade, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("ending", ["mp4", "avi", "mkv"])
@pytest.mark.parametrize("kind", LISTS)
def test_a_list_of_other_files_is_no_video(kind: str, ending: str, tmp_path: Path) -> None:
    write_video(tmp_path / "real.mp4")
    path = tmp_path / f"list.{ending}"
    path.write_text(LISTS[kind])
    with refused(DataError, path, "opened as a video"):
        image_source(str(path))
    with refused(DataError, path.name, "opened as a video"):
        read_clip(path, 64)


def test_a_name_is_no_pattern_and_no_protocol(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for number in range(3):
        cv2.imwrite(f"{number:02d}.png", np.zeros((64, 96, 3), np.uint8))
        Path(f"{number:02d}.png").rename(f"{number:02d}.mp4")
    assert len(list(image_source("00.mp4"))) == 1  # an image by what it holds, and no row of them
    for name in ("%02d.mp4", "image2:x.mp4"):
        Path(name).touch()
        with refused(DataError, name, "opened as a video"):
            image_source(name)
    write_video(Path("a.mp4")).rename("concat:b.mp4")
    assert len(list(image_source("concat:b.mp4"))) == 5


@pytest.mark.parametrize("ending", VIDEOS)
def test_the_videos_that_are_promised_are_read(ending: str, tmp_path: Path) -> None:
    path = write_video(tmp_path / f"a.{ending}", VIDEOS[ending])
    assert open_video(path).isOpened()
    assert sum(shot.image is not None for shot in image_source(str(path))) == 5


@pytest.mark.parametrize("size", [(1, 24_000_000), (24_000_000, 1), (2, 41)])
def test_a_line_is_no_image(size: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Image.new("L", size).save(path)
    for read in (read_image, read_photo):
        with refused(DataError, None, "a.png: ", "20 times", f"{size[1]} x {size[0]}"):
            read(path)

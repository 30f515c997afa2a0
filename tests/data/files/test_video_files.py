"""Videos and files of several pictures: every frame is taken, and only what is missing is missed."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import refused

from col3d.data.files.images import image_source
from col3d.data.files.sources import SourceImage
from col3d.data.files.video_containers import container_of, declared_length, missing_bytes
from col3d.errors import DataError

SIZE = (64, 96)
SHADES = (20, 60, 100, 140, 180)


LISTS = (b"#EXTM3U\n#EXTINF:1,\nreal.mp4\n", b"ffconcat version 1.0\nfile real.mp4\n")


def frame(shade: int) -> np.ndarray:
    return np.full((*SIZE, 3), shade, np.uint8)


def video(path: Path, code: str = "mp4v", frames: int = 5) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 25, SIZE[::-1])
    for number in range(frames):
        writer.write(frame(SHADES[number % len(SHADES)]))
    writer.release()
    return path


def read(path: Path) -> tuple[list[int], list[str]]:
    """The shade of each picture, and what is wrong."""
    shots: list[SourceImage] = list(image_source(str(path)))
    shades = [round(float(shot.image[..., 0].mean())) for shot in shots if shot.image is not None]
    return shades, [shot.fault for shot in shots if shot.fault]


@pytest.mark.parametrize(
    ("written", "code", "name"),
    [
        ("a.ts", "mpg2", "a.ts"),
        ("a.ts", "mpg2", "a.m2ts"),
        ("a.mpg", "mpg1", "a.vob"),
        ("a.mp4", "mp4v", "a.3gp"),
        ("a.mp4", "mp4v", "clip"),
        ("a.avi", "MJPG", "a.dat"),
        ("a.flv", "FLV1", "a.flv"),
        ("a.mkv", "mp4v", "recording.bin"),
    ],
)
def test_what_is_in_a_file_makes_it_a_video(written: str, code: str, name: str, tmp_path: Path) -> None:
    path = video(tmp_path / written, code).rename(tmp_path / name)
    source = image_source(str(path))
    shades, faults = read(path)
    assert source.is_video
    assert np.abs(np.subtract(shades, SHADES)).max() < 8
    assert faults == []


@pytest.mark.parametrize("name", ["notes.txt", "a.csv", "clip", "a.m3u8", "a.ts"])
@pytest.mark.parametrize(
    "content",
    [b"", b"no video", b"#EXTM3U\n#EXTINF:1,\nreal.mp4\n", b"ffconcat version 1.0\nfile real.mp4\n"],
)
def test_what_is_neither_is_refused_before_anything_else(name: str, content: bytes, tmp_path: Path) -> None:
    video(tmp_path / "real.mp4")
    (tmp_path / name).write_bytes(content)
    with refused(DataError, tmp_path / name, "no image either"):
        image_source(str(tmp_path / name))


def test_frames_at_uneven_times_are_not_counted_against_a_rate(tmp_path: Path) -> None:
    """A container of 30 frames in 4 seconds whose rate is 30 a second says 120."""
    path = video(tmp_path / "a.mkv")
    source = image_source(str(path))
    source.count = 120
    assert len(list(source)) == 5
    assert [shot.fault for shot in source if shot.fault] == []


@pytest.mark.parametrize("name", ["a.mp4", "a.mov", "a.avi", "a.mkv"])
def test_a_video_that_is_cut_off_says_so(name: str, tmp_path: Path) -> None:
    path = video(tmp_path / name, "MJPG", 40)
    assert missing_bytes(path) == 0
    whole = path.read_bytes()
    path.write_bytes(whole[:-1000])
    assert 0 < missing_bytes(path) <= 1000
    if name in ("a.avi", "a.mkv"):  # the others keep the table of their frames at the end
        shades, faults = read(path)
        assert 10 < len(shades) <= 40
        assert len(faults) == 1
        for named in (f"{path}: ", "1000 bytes", f"{len(shades)} frames"):
            assert named in faults[0]
    else:
        with refused(DataError, path, "opened as a video"):
            image_source(str(path))


CONTAINERS = {
    "a.mp4": ("mp4v", "MP4"),
    "a.mov": ("mp4v", "MP4"),
    "a.3gp": ("mp4v", "MP4"),
    "a.avi": ("MJPG", "AVI"),
    "a.mkv": ("mp4v", "Matroska"),
    "a.webm": ("VP80", "Matroska"),
    "a.flv": ("FLV1", "FLV"),
    "a.wmv": ("WMV2", "ASF"),
    "a.asf": ("WMV2", "ASF"),
    "a.mxf": ("mpg2", "MXF"),
}
SILENT = {
    "a.ts": ("mpg2", "MPEG transport stream"),
    "a.m2ts": ("mpg2", "MPEG transport stream"),
    "a.mpg": ("mpg1", "MPEG program stream"),
}
"""Containers that do not say how long they are."""


@pytest.mark.parametrize("name", CONTAINERS)
def test_a_whole_container_is_as_long_as_it_says(name: str, tmp_path: Path) -> None:
    code, container = CONTAINERS[name]
    path = video(tmp_path / name, code, 40)
    assert container_of(path) == container
    assert declared_length(path) == path.stat().st_size
    assert image_source(str(path)).notes == ()
    assert read(path)[1] == []


@pytest.mark.parametrize("kept", [0.3, 0.7, -100, -1])
@pytest.mark.parametrize("name", CONTAINERS)
def test_a_container_that_is_cut_anywhere_says_so(name: str, kept: float, tmp_path: Path) -> None:
    path = video(tmp_path / name, CONTAINERS[name][0], 40)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * kept)] if kept > 0 else content[: int(kept)])
    missing = missing_bytes(path)
    assert 0 < missing <= len(content) - path.stat().st_size
    try:
        faults = read(path)[1]
    except DataError as error:
        faults = [str(error)]
    assert len(faults) == 1
    assert faults[0].startswith(f"{path}: ")
    assert f" {missing} bytes " in faults[0]


@pytest.mark.parametrize("name", SILENT)
def test_a_container_that_cannot_tell_is_said_to_be_so(name: str, tmp_path: Path) -> None:
    code, container = SILENT[name]
    path = video(tmp_path / name, code)
    assert container_of(path) == container
    assert image_source(str(path)).notes == (
        f"note: {path}: a {container} need not say how long it is, and this one does not: nothing tells "
        "whether its end is missing",
    )
    assert read(path)[1] == []


def test_an_flv_without_its_length_is_walked(tmp_path: Path) -> None:
    path = video(tmp_path / "a.flv", "FLV1", 40)
    content = path.read_bytes().replace(b"filesize", b"filesome")
    path.write_bytes(content)
    assert declared_length(path) == len(content)
    path.write_bytes(content[:-5])
    assert missing_bytes(path) == 5


def test_a_damaged_container_is_told_from_what_is_no_video(tmp_path: Path) -> None:
    path = video(tmp_path / "a.mp4", "mp4v", 40)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"moov", b"mooV"))
    with refused(DataError, path, "opened as a video", "(MP4)"):
        image_source(str(path))
    path.write_bytes(content.replace(b"avc1mp41", b"").replace(b"stsz", b"xxxx"))
    with refused(DataError, path, "no frame of it"):
        image_source(str(path))


@pytest.mark.parametrize("ending", [".jpg", ".png", ".tif", ".dat", ""])
@pytest.mark.parametrize(("written", "code"), [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "mp4v")])
def test_a_video_is_one_under_any_name(written: str, code: str, ending: str, tmp_path: Path) -> None:
    path = video(tmp_path / written, code).rename(tmp_path / f"clip{ending}")
    assert image_source(str(path)).is_video
    assert len(read(path)[0]) == 5


@pytest.mark.parametrize("ending", [".avi", ".mp4", ".webm", ".dat", ""])
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "TIFF", "WEBP", "GIF"])
def test_an_image_is_one_under_any_name(kind: str, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"photo{ending}"
    Image.fromarray(frame(60)).save(path, kind)
    assert not image_source(str(path)).is_video
    shades, faults = read(path)
    assert np.abs(np.subtract(shades, [60])).max() <= 2
    assert faults == []


def test_bytes_that_containers_announce(tmp_path: Path) -> None:
    box = struct.pack(">I4s", 16, b"ftyp") + bytes(8)
    large = struct.pack(">I4sQ", 1, b"mdat", 40) + bytes(24)
    rest = struct.pack(">I4s", 0, b"mdat") + bytes(9)
    riff = b"RIFF" + struct.pack("<I", 13) + b"AVI " + bytes(9)
    head = b"\x1a\x45\xdf\xa3\x83abc\x18\x53\x80\x67"
    for content, missing in (
        (box + large, 0),
        (box + large[:-7], 7),
        (box + rest, 0),
        (riff + b"\0" + riff, 0),
        (riff + b"\0" + riff[:-4], 4),
        (head + b"\x85abcde", 0),
        (head + b"\x40\x05abc", 2),
        (head + b"\x01" + b"\xff" * 7 + b"abc", 0),
        (b"something else", 0),
        (b"", 0),
    ):
        (tmp_path / "a").write_bytes(content)
        assert missing_bytes(tmp_path / "a") == missing


def test_a_folder_of_videos_says_what_to_name(tmp_path: Path) -> None:
    for name in ("b.mp4", "a.MP4"):
        (tmp_path / name).touch()
    with refused(DataError, None, str(tmp_path), "2 videos", "a.MP4"):
        image_source(str(tmp_path))


def animated(path: Path) -> Path:
    pictures = [Image.fromarray(frame(shade)) for shade in SHADES]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=40, lossless=True)
    return path


@pytest.mark.parametrize("name", ["a.gif", "a.webp", "a.png", "a.apng"])
def test_every_frame_of_an_animation_is_taken(name: str, tmp_path: Path) -> None:
    path = animated(tmp_path / name)
    source = image_source(str(path))
    shades, faults = read(path)
    assert source.is_video
    assert (source.count, source.fps) == (5, 25)
    assert np.abs(np.subtract(shades, SHADES)).max() <= 4
    assert faults == []
    assert [shot.name for shot in source][:2] == ["000000", "000001"]


@pytest.mark.parametrize("name", ["a.gif", "a.webp", "a.png"])
@pytest.mark.parametrize("kept", [0.5, 0.9, -1])
def test_an_animation_that_is_cut_off_is_refused(name: str, kept: float, tmp_path: Path) -> None:
    path = animated(tmp_path / name)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * kept)] if kept > 0 else content[:-1])
    with refused(DataError, path):
        image_source(str(path))


def test_a_gif_of_one_picture_is_an_image(tmp_path: Path) -> None:
    Image.fromarray(frame(60)).save(tmp_path / "a.gif")
    source = image_source(str(tmp_path / "a.gif"))
    assert not source.is_video
    assert [shot.name for shot in source] == ["a"]


@pytest.mark.parametrize("compression", [None, "lzw", "zlib", "jpeg"])
def test_every_page_of_a_tiff_is_taken(compression: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as file:
        for shade in SHADES:
            file.write(frame(shade), photometric="rgb", compression=compression)
            file.write(frame(255)[::4, ::4], photometric="rgb", subfiletype=1)
    shades, faults = read(path)
    assert np.abs(np.subtract(shades, SHADES)).max() <= 1
    assert faults == []
    assert not image_source(str(path)).is_video


def test_pages_of_other_colours_are_converted(tmp_path: Path) -> None:
    modes = zip(SHADES, ("L", "P", "CMYK", "RGBA", "RGB"), strict=True)
    pages = [Image.fromarray(frame(shade)).convert(mode) for shade, mode in modes]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    shades, faults = read(tmp_path / "a.tif")
    assert np.abs(np.subtract(shades, SHADES)).max() <= 1
    assert faults == []


def test_a_broken_page_is_named_and_the_others_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as file:
        for shade in SHADES:
            file.write(frame(shade), photometric="rgb", compression="zlib")
    with tifffile.TiffFile(path) as file:
        start = file.pages[2].dataoffsets[0]
    content = bytearray(path.read_bytes())
    content[start + 5 : start + 40] = bytes(35)
    path.write_bytes(content)
    shades, faults = read(path)
    assert shades == [20, 60, 140, 180]
    assert len(faults) == 1
    assert faults[0].startswith(f"{path}: ")
    assert "picture 3 of 5" in faults[0]


def test_a_video_without_a_frame_that_decodes_is_refused_by_name(tmp_path: Path) -> None:
    """An AVIF is one: OpenCV opens it as a video and then has no decoder for it."""
    path = tmp_path / "photo.avif"
    Image.new("RGB", (64, 48)).save(path)
    with refused(DataError, path, "no frame of it"):
        image_source(str(path))

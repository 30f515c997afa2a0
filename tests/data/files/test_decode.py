"""One strict decoder: any whole image is read as OpenCV reads it, and no damaged one is, by any reader."""

import errno
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import refused

from col3d.data.files.decode import read_rgb8, read_whole
from col3d.data.files.image_files import check_header, read_colour
from col3d.data.files.images import read_image
from col3d.errors import DataError, DiskError
from col3d.inference.demo.uploads import read_photo

SIZE = (72, 96)


def picture() -> np.ndarray:
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    noise = np.random.default_rng(0).normal(0, 9, (*SIZE, 3))
    waves = np.stack([np.sin(x / 9), np.cos(y / 7), np.sin((x + y) / 11)], axis=-1)
    return np.clip(120 + 80 * waves + noise, 0, 255).astype(np.uint8)


def pillow(kind: str, mode: str = "RGB", **options: Any) -> bytes:
    content = io.BytesIO()
    Image.fromarray(picture()).convert(mode).save(content, kind, **options)
    return content.getvalue()


def tiff(pixels: np.ndarray, **options: Any) -> bytes:
    content = io.BytesIO()
    tifffile.imwrite(content, pixels, **options)
    return content.getvalue()


def rgb_tiff(compression: str | None) -> bytes:
    return tiff(picture(), photometric="rgb", compression=compression, rowsperstrip=8)


def sixteen(ending: str) -> bytes:
    return cv2.imencode(ending, picture().astype(np.uint16) * 256 + 77)[1].tobytes()


WHOLE: dict[str, bytes] = {
    **{f"{mode}.png": pillow("PNG", mode) for mode in ("RGB", "RGBA", "L", "LA", "P", "1")},
    "16.png": sixteen(".png"),
    **{f"{mode}.jpg": pillow("JPEG", mode) for mode in ("RGB", "L", "CMYK")},
    "progressive.jpg": pillow("JPEG", progressive=True),
    "restarts.jpg": pillow("JPEG", restart_marker_rows=1),
    **{f"{mode}.bmp": pillow("BMP", mode) for mode in ("RGB", "RGBA", "L", "P", "1")},
    "lossy.webp": pillow("WEBP"),
    "lossless.webp": pillow("WEBP", "RGBA", lossless=True),
    **{f"{name}.tif": rgb_tiff(name) for name in ("lzw", "zlib", "packbits", "jpeg")},
    "raw.tif": rgb_tiff(None),
    **{f"{mode}.tif": pillow("TIFF", mode) for mode in ("L", "P", "CMYK", "RGBA", "1")},
    "planar.tif": tiff(np.moveaxis(picture(), -1, 0), photometric="rgb", planarconfig="separate"),
    "white_is_0.tif": tiff(picture()[..., 0], photometric="miniswhite"),
    "tiles.tif": tiff(picture(), photometric="rgb", tile=(16, 16), compression="zlib"),
    "16.tif": tiff(picture().astype(np.uint16) * 256, photometric="rgb"),
}
CHECKED = ("png", "zlib", "tiles")
"""What has checksums, so that no change of it goes unseen."""
TELLING = ("png", "jpg", "lzw.tif", "zlib.tif", "tiles.tif")
"""What shows damage between its first and last bytes."""
SILENT = ("CMYK.jpg", "progressive.jpg")
"""JPEGs that do not: the decoder of four colours is another, and any bits refine a progressive one."""
READERS: list[Callable[[Path], Any]] = [
    read_rgb8,
    read_whole,
    read_image,
    read_photo,
    lambda path: read_colour(path, SIZE),
]


def written(tmp_path: Path, name: str, content: bytes) -> Path:
    path = tmp_path / name
    path.write_bytes(content)
    return path


def by_opencv(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)


@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_image_is_read_as_opencv_reads_it(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, WHOLE[name])
    check_header(path, SIZE, None, None)
    pixels = read_rgb8(path)
    rounding = 1 if name in ("CMYK.jpg", "16.tif") else 0
    assert pixels.shape == (*SIZE, 3)
    assert pixels.dtype == np.uint8
    assert np.abs(pixels.astype(int) - by_opencv(path)).max() <= rounding
    assert (read_image(path) == pixels).all()
    assert (read_colour(path, SIZE) == pixels).all()


@pytest.mark.parametrize("kept", [0.25, 0.5, 0.67, 0.9, -1])
@pytest.mark.parametrize("name", WHOLE)
def test_a_truncated_image_is_refused_by_every_reader(name: str, kept: float, tmp_path: Path) -> None:
    content = WHOLE[name]
    path = written(tmp_path, name, content[: int(len(content) * kept)] if kept > 0 else content[:-1])
    for read in (*READERS, lambda path: check_header(path, SIZE, None, None)):
        with refused(DataError, None, f"{name}: "):
            read(path)


@pytest.mark.parametrize("at", [0.4, 0.6, 0.8])
@pytest.mark.parametrize("name", [name for name in WHOLE if name.endswith(TELLING) and name not in SILENT])
def test_a_hole_in_the_data_is_refused_where_the_format_tells(name: str, at: float, tmp_path: Path) -> None:
    """Decoders fill such a hole with grey or with what came before; the end of the file is as it was."""
    content = WHOLE[name]
    start, length = int(len(content) * at), max(40, len(content) // 20)
    path = written(tmp_path, name, content[:start] + bytes(length) + content[start + length :])
    for read in READERS:
        with refused(DataError, None, f"{name}: ", "decoded ("):
            read(path)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("name", [name for name in WHOLE if any(kind in name for kind in CHECKED)])
def test_a_turned_bit_is_refused_where_there_is_a_checksum(name: str, seed: int, tmp_path: Path) -> None:
    content, rng = bytearray(WHOLE[name]), np.random.default_rng(seed)
    first = content.index(b"IDAT") if name.endswith("png") else 1200
    last = len(content) - (20 if name.endswith("png") else 1200)
    content[int(rng.integers(first, last))] ^= 1 << int(rng.integers(8))
    path = written(tmp_path, name, bytes(content))
    for read in READERS:
        with refused(DataError, None, f"{name}: ", "decoded ("):
            read(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("grey.png", cv2.imencode(".png", picture()[..., 0].astype(np.uint16) * 256)[1].tobytes()),
        ("grey.tif", tiff(picture()[..., 0].astype(np.uint16) * 256)),
        ("float.tif", tiff(picture()[..., 0].astype(np.float32))),
        ("double.tif", tiff(picture()[..., 0].astype(np.float64))),
        ("colour_float.tif", tiff(picture().astype(np.float32), photometric="rgb")),
    ],
)
def test_what_would_lose_range_is_no_photo(name: str, content: bytes, tmp_path: Path) -> None:
    path = written(tmp_path, name, content)
    for read in (
        read_rgb8,
        read_image,
        lambda path: read_colour(path, SIZE),
        lambda path: check_header(path, SIZE, None, None),
    ):
        with refused(DataError, None, f"{name}: ", "8 bits"):
            read(path)


@pytest.mark.parametrize("name", ["RGB.png", "RGB.jpg"])
def test_bytes_behind_the_end_do_no_harm(name: str, tmp_path: Path) -> None:
    """Cameras and archives add some; the picture is whole."""
    for more in (b"\0" * 9, b"camera data" * 20):
        path = written(tmp_path, name, WHOLE[name] + more)
        check_header(path, SIZE, None, None)
        assert (read_rgb8(path) == by_opencv(path)).all()


def test_the_small_picture_in_a_header_ends_no_jpeg(tmp_path: Path) -> None:
    """Its mark of an end is not that of the whole file."""
    whole, thumbnail = WHOLE["RGB.jpg"], WHOLE["L.jpg"]
    extra = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    content = whole[:2] + extra + whole[2:]
    check_header(written(tmp_path, "a.jpg", content), SIZE, None, None)
    path = written(tmp_path, "a.jpg", content[:-200])
    with refused(DataError, path, "truncated"):
        check_header(path, SIZE, None, None)


@pytest.mark.parametrize("ending", ["tif", "webp", "png"])
def test_a_data_set_takes_no_file_of_several_pictures(ending: str, tmp_path: Path) -> None:
    pages = [Image.fromarray(picture()), Image.fromarray(255 - picture())]
    pages[0].save(tmp_path / f"a.{ending}", save_all=True, append_images=pages[1:])
    with refused(DataError, tmp_path / f"a.{ending}", "one picture", "got 2 "):
        check_header(tmp_path / f"a.{ending}", SIZE, None, None)


@pytest.mark.parametrize("read", [*READERS[:3], lambda path: check_header(path, SIZE, None, None)])
def test_a_disk_that_fails_says_nothing_of_the_image(
    read: Callable[[Path], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, "RGB.png", WHOLE["RGB.png"])

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.EIO, "Input/output error", str(path))

    monkeypatch.setattr(Path, "open", fail)
    with refused(DiskError, None, "RGB.png: ", "(Input/output error)"):
        read(path)

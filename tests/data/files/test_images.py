"""Images of any source come in their order, under names of their own, and what is broken is said."""

import errno
import os
import threading
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from refusals import refused

from col3d.data.ahead import ahead
from col3d.data.datasets.release import standard_normals
from col3d.data.files.encode import depth_codes, normal_codes, write_tiff
from col3d.data.files.image_files import read_grey, read_rgb
from col3d.data.files.images import image_source, read_image
from col3d.errors import DataError, DiskError


def save(path: Path, shade: int = 100, mode: str = "RGB") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new(mode, (6, 4), shade if mode != "RGB" else (shade, 0, 10)).save(path)
    return path


def test_numbers_in_names_count_as_numbers(tmp_path: Path) -> None:
    for number in (10, 9, 100):
        save(tmp_path / f"frame_{number}.png", number)
    (tmp_path / "notes.txt").write_text("no image")
    source = image_source(str(tmp_path))
    shots = list(source)
    assert [shot.name for shot in shots] == ["frame_9", "frame_10", "frame_100"]
    assert [int(shot.image[0, 0, 0]) for shot in shots if shot.image is not None] == [9, 10, 100]
    assert (source.is_video, source.count) == (False, 3)


def test_files_of_one_stem_have_names_of_their_own(tmp_path: Path) -> None:
    for name in ("a/1.png", "b/1.png", "b/1.jpg"):
        save(tmp_path / name)
    names = [shot.name for shot in image_source(str(tmp_path / "**" / "1.*"))]
    assert sorted(names) == ["a_1_png", "b_1_jpg", "b_1_png"]
    for name in ("x.y.png", "x_y.png", "a.png", "a.jpg"):
        save(tmp_path / "in [1]" / name)
    alike = [shot.name for shot in image_source(str(tmp_path / "in [1]" / "*"))]
    assert sorted(alike) == ["a_jpg", "a_png", "x_y_png", "x_y_png_2"]


def test_the_video_of_c3vd_is_known_by_the_names_of_its_files(tmp_path: Path) -> None:
    for name in ("9_color.png", "0010_color.png", "0010_depth.tiff"):
        save(tmp_path / "one" / name)
    save(tmp_path / "two" / "rgb" / "0003.png")
    one, two = (image_source(str(tmp_path / name)) for name in ("one", "two"))
    assert [(shot.name, shot.number) for shot in one] == [("0009", 9), ("0010", 10)]
    assert [shot.name for shot in two] == ["0003"]
    assert one.is_video
    assert two.is_video


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK", "1"])
def test_images_of_eight_bits_become_rgb(mode: str, tmp_path: Path) -> None:
    path = save(tmp_path / ("a.tiff" if mode == "CMYK" else "a.png"), 1, mode)
    assert read_image(path).shape == (4, 6, 3)


def test_what_is_no_image_is_said(tmp_path: Path) -> None:
    save(tmp_path / "deep.png", 700, "I;16")
    with refused(DataError, tmp_path / "deep.png", "8 bits"):
        read_image(tmp_path / "deep.png")
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "cut.jpg")
    whole = (tmp_path / "cut.jpg").read_bytes()
    (tmp_path / "cut.jpg").write_bytes(whole[: len(whole) // 2])
    with refused(DataError, tmp_path / "cut.jpg", "cut off"):
        read_image(tmp_path / "cut.jpg")
    (tmp_path / "empty").mkdir()
    for given, said in (
        ("empty", "holds no image"),
        ("x*.png", "matches no image"),
        ("no.png", "no such file"),
    ):
        with refused(DataError, None, tmp_path / given, said):
            image_source(str(tmp_path / given))
    (tmp_path / "clip.mp4").write_text("no video")
    with refused(DataError, tmp_path / "clip.mp4", "video"):
        image_source(str(tmp_path / "clip.mp4"))


def test_reading_ahead_keeps_the_order_and_the_errors() -> None:
    def items() -> Iterator[int]:
        yield from range(20)
        raise OSError("the disk is gone")

    reader = ahead(items(), 3)
    seen = list(islice(reader, 20))
    with refused(OSError, None, "the disk is gone"):
        next(reader)
    assert seen == list(range(20))


def test_reading_ahead_stops_with_its_reader() -> None:
    made, before = [], threading.active_count()

    def endless() -> Iterator[int]:
        while True:
            made.append(len(made))
            yield made[-1]

    reader = ahead(endless(), 2)
    assert [next(reader) for _ in range(3)] == [0, 1, 2]
    reader.close()
    for thread in threading.enumerate()[before:]:
        thread.join(timeout=5)
    assert threading.active_count() == before
    assert len(made) < 10


def test_codes_are_those_of_the_current_release(tmp_path: Path) -> None:
    depth = np.array([[0.0, 0.001, 49.999], [99.999, 100.0, 140.0]], np.float32)
    codes = depth_codes(depth, 100.0)
    assert codes.tolist() == [[1, 1, 32767], [65534, 65534, 65534]]
    mask = np.array([[True, False, True], [True, True, False]])
    assert (depth_codes(depth, 100.0, mask) == np.where(mask, codes, 0)).all()
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(4, 6, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    write_tiff(tmp_path / "n.tiff", normal_codes(normals))
    write_tiff(tmp_path / "d.tiff", np.arange(24, dtype=np.uint16).reshape(4, 6))
    assert (read_grey(tmp_path / "d.tiff", (4, 6), np.uint16) == np.arange(24).reshape(4, 6)).all()
    back = standard_normals(read_rgb(tmp_path / "n.tiff", (4, 6), np.uint16), "current").permute(1, 2, 0)
    assert np.abs(back.numpy() - normals).max() < 1e-4


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.EACCES])
def test_a_disk_that_fails_is_no_broken_image(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a.png", "b.png"):
        save(tmp_path / name)
    source = image_source(str(tmp_path))
    opened, reason = Path.open, os.strerror(number)

    def fails(self: Path, *mode: Any, **options: Any) -> Any:
        if self.name == "b.png":
            raise OSError(number, reason)
        return opened(self, *mode, **options)

    monkeypatch.setattr(Path, "open", fails)
    if number == errno.EACCES:  # of the one file
        first, second = source
        assert first.image is not None
        assert (second.image, reason in second.fault) == (None, True)
        return
    with refused(DiskError, tmp_path / "b.png", f"({reason})"):
        list(source)

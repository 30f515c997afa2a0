"""Depth as any program stores it: the same numbers from every type, and one verdict of header and reader."""

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import refused

from col3d.data.datasets.folder import FolderFrames
from col3d.data.files.depth_files import TAKEN, check_depth_file, read_depth_file
from col3d.errors import DataError

SIZE = (24, 32)
STEPS = np.random.default_rng(0).integers(1, 100, SIZE)
"""Depth that every type holds exactly."""
Write = Callable[[Path, np.ndarray], Any]


def stacked(count: int, alpha: bool = False) -> Callable[[np.ndarray], np.ndarray]:
    def stack(values: np.ndarray) -> np.ndarray:
        other = np.arange(values.size).reshape(values.shape).astype(values.dtype)
        return np.dstack([values] * (count - alpha) + [other] * alpha)

    return stack


def pfm(path: Path, values: np.ndarray, order: str = "<") -> None:
    kind, scale = ("Pf" if values.ndim == 2 else "PF"), ("-1.0" if order == "<" else "1.0")
    head = f"{kind}\n{values.shape[1]} {values.shape[0]}\n{scale}\n".encode()
    path.write_bytes(head + values[::-1].astype(f"{order}f4").tobytes())


def pillow(mode: str | None = None, **options: Any) -> Write:
    def write(path: Path, values: np.ndarray) -> None:
        image = Image.fromarray(values)
        (image.convert(mode) if mode else image).save(path, **options)

    return write


def opencv(path: Path, values: np.ndarray) -> None:
    cv2.imwrite(str(path), values)


def tiff(**options: Any) -> Write:
    return lambda path, values: tifffile.imwrite(path, values, **options)


def with_thumbnail(path: Path, values: np.ndarray) -> None:
    with tifffile.TiffWriter(path) as file:
        file.write(values)
        file.write(values[::4, ::4], subfiletype=1)


NUMBERS = ("u1", "u2", "u4", "u8", "i2", "i4", "i8", "f2", "f4", "f8", ">f4", ">u2")
READ: dict[str, tuple[str, Write, Callable[[np.ndarray], np.ndarray]]] = {
    **{f"npy {kind}": ("npy", np.save, lambda v, kind=kind: v.astype(kind)) for kind in NUMBERS},
    "npy h w 1": ("npy", np.save, lambda v: v[..., None]),
    "npy 1 h w": ("npy", np.save, lambda v: v[None]),
    "npy 3 h w": ("npy", np.save, lambda v: np.stack([v] * 3)),
    "npy columns first": ("npy", np.save, np.asfortranarray),
    "npz": ("npz", lambda path, v: np.savez(path, depth=v), np.asarray),
    "npz packed": ("npz", np.savez_compressed, np.asarray),
    "pfm": ("pfm", pfm, np.asarray),
    "pfm of the other order": ("pfm", lambda path, v: pfm(path, v, ">"), np.asarray),
    "pfm of 3": ("pfm", pfm, stacked(3)),
    **{f"tiff {kind}": ("tif", tiff(), lambda v, kind=kind: v.astype(kind)) for kind in NUMBERS},
    **{
        f"tiff {name}": ("tif", tiff(compression=name), lambda v: v.astype(np.float32))
        for name in ("lzw", "zlib", "packbits", "zstd", "lzma", "adobe_deflate")
    },
    "tiff predicted": ("tif", tiff(compression="zlib", predictor=3), lambda v: v.astype(np.float32)),
    "tiff tiles": ("tif", tiff(tile=(16, 16)), lambda v: v.astype(np.float32)),
    "tiff large": ("tif", tiff(bigtiff=True), lambda v: v.astype(np.float64)),
    "tiff rgb": ("tif", tiff(photometric="rgb"), lambda v: stacked(3)(v.astype(np.float32))),
    "tiff rgb lzw": ("tif", tiff(photometric="rgb", compression="lzw"), lambda v: stacked(3)(v.astype("u2"))),
    "tiff planes": (
        "tif",
        tiff(photometric="rgb", planarconfig="separate"),
        lambda v: np.stack([v.astype(np.float32)] * 3),
    ),
    "tiff rgba": ("tif", opencv, lambda v: stacked(4, alpha=True)(v.astype(np.uint16))),
    "tiff with a small copy": ("tif", with_thumbnail, lambda v: v.astype(np.uint16)),
    "tiff by opencv": ("tif", opencv, lambda v: v.astype(np.float32)),
    "png 8": ("png", opencv, lambda v: v.astype(np.uint8)),
    "png 16": ("png", opencv, lambda v: v.astype(np.uint16)),
    "png rgb 8": ("png", opencv, lambda v: stacked(3)(v.astype(np.uint8))),
    "png rgb 16": ("png", opencv, lambda v: stacked(3)(v.astype(np.uint16))),
    "png rgba 8": ("png", opencv, lambda v: stacked(4, alpha=True)(v.astype(np.uint8))),
    "png rgba 16": ("png", opencv, lambda v: stacked(4, alpha=True)(v.astype(np.uint16))),
    "png grey and alpha": ("png", pillow(), lambda v: stacked(2, alpha=True)(v.astype(np.uint8))),
    "png palette": ("png", pillow("P"), lambda v: v.astype(np.uint8)),
    "bmp": ("bmp", pillow(), lambda v: v.astype(np.uint8)),
    "bmp rgb": ("bmp", pillow(), lambda v: stacked(3)(v.astype(np.uint8))),
    "webp": ("webp", pillow(lossless=True), lambda v: stacked(3)(v.astype(np.uint8))),
}


@pytest.mark.parametrize("name", READ)
def test_the_same_numbers_from_every_type(name: str, tmp_path: Path) -> None:
    ending, write, shaped = READ[name]
    path = tmp_path / f"a.{ending}"
    write(path, shaped(STEPS))
    check_depth_file(path, SIZE)
    assert (read_depth_file(path, SIZE) == STEPS).all()


def xyz(values: np.ndarray) -> np.ndarray:
    return np.dstack([values * 0 - 3, values * 2, values]).astype(np.float32)


@pytest.mark.parametrize(
    ("ending", "write"), [("npy", np.save), ("pfm", pfm), ("tif", tiff(photometric="rgb"))]
)
def test_a_channel_of_several_is_chosen(ending: str, write: Write, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    write(path, xyz(STEPS))
    for channel, factor in ((1, 2), (2, 1)):
        assert (read_depth_file(path, SIZE, channel) == factor * STEPS).all()
    with refused(DataError, path, "one channel", "got 3 "):
        read_depth_file(path, SIZE)
    with refused(DataError, path, "channel 3", "data.layout.depth_channel"):
        check_depth_file(path, SIZE, 3)


def pages(path: Path, count: int) -> None:
    tifffile.imwrite(path, np.stack([STEPS.astype("u2")] * count), photometric="minisblack")


def nothing(path: Path) -> None:
    path.write_bytes(b"")


def zipped_text(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.txt", "no array")


def as_gif(path: Path) -> None:
    content = io.BytesIO()
    Image.fromarray(STEPS.astype(np.uint8)).save(content, "GIF")
    path.write_bytes(content.getvalue())


REFUSED: list[tuple[str, Callable[[Path], Any], tuple[str, ...]]] = [
    ("a.npy", lambda path: np.save(path, STEPS > 9), ("got bool;", TAKEN)),
    ("a.npy", lambda path: np.save(path, STEPS * 1j), ("got complex128;", TAKEN)),
    ("a.npy", lambda path: np.save(path, STEPS.astype(object)), ("got object;", TAKEN)),
    ("a.npz", lambda path: np.savez(path, STEPS.astype(object)), ("got object;", TAKEN)),
    ("a.npy", lambda path: np.save(path, STEPS.astype([("z", "f4")])), ("got [('z', '<f4')];", TAKEN)),
    ("a.npz", lambda path: np.savez(path, x=STEPS, y=STEPS), ("NPZ", "got 2 (x, y)")),
    ("a.npz", zipped_text, ("cannot be decoded",)),
    ("a.npy", lambda path: np.save(path, STEPS[1:]), ("24 x 32", "(23, 32)")),
    ("a.png", lambda path: opencv(path, STEPS[1:].astype("u2")), ("24 x 32", "got 23 x 32")),
    ("a.png", lambda path: Image.new("1", SIZE[::-1]).save(path), ("8 bits or more", "got ")),
    ("a.tif", lambda path: pages(path, 4), ("got 4 pages",)),
    ("a.tif", lambda path: pillow("P")(path, STEPS.astype("u1")), ("palette",)),
    ("a.tif", lambda path: tifffile.imwrite(path, STEPS * 1j), ("8 bits or more",)),
    ("a.exr", lambda path: path.write_bytes(b"\x76\x2f\x31\x01" + bytes(99)), ("not a map", TAKEN)),
    ("a.png", as_gif, ("not a map", TAKEN)),
    ("a.txt", lambda path: np.savetxt(path, STEPS), ("not a map", TAKEN)),
    ("a.npy", nothing, ("not a map", TAKEN)),
    ("a.npy", Path.absolute, ("no such file",)),
]


@pytest.mark.parametrize(("name", "write", "named"), REFUSED)
def test_what_is_no_depth_is_refused_by_its_header_and_by_the_reader(
    name: str, write: Callable[[Path], Any], named: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / name
    write(path)
    for look in (check_depth_file, read_depth_file):
        with refused(DataError, path, *named):
            look(path, SIZE)


SPARE_END = ("tiff with a small copy", "tiff tiles")
"""What they end in is no part of the depth."""


@pytest.mark.parametrize("kept", [0.3, 0.66, -1])
@pytest.mark.parametrize("name", [name for name in READ if name not in SPARE_END])
def test_damaged_depth_is_refused(name: str, kept: float, tmp_path: Path) -> None:
    ending, write, shaped = READ[name]
    path = tmp_path / f"a.{ending}"
    write(path, shaped(STEPS))
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * kept)] if kept > 0 else content[:-1])
    with refused(DataError, path):
        read_depth_file(path, SIZE)


def test_an_object_in_an_array_is_never_called(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "sprung",))

    np.save(tmp_path / "a.npy", np.array([Trap()], object))
    np.savez(tmp_path / "a.npz", np.array([Trap()], object))
    for name in ("a.npy", "a.npz"):
        with refused(DataError, tmp_path / name, "got object"):
            read_depth_file(tmp_path / name, (1, 1))
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
def test_what_is_no_depth_in_floats_does_not_count(kind: str, tmp_path: Path) -> None:
    values = np.full(SIZE, 20, kind)
    values[0, :5] = [np.nan, np.inf, -np.inf, -4, 0]
    folder(tmp_path, lambda path: np.save(path, values))
    item = FolderFrames(tmp_path, ["a"], "{}.png", "{}_depth.npy", 1.0, 100.0, normals="none")[0]
    assert item["mask"][0, 0].tolist() == [False] * 5 + [True] * (SIZE[1] - 5)
    assert item["depth"][0, 0].tolist() == [0.0] * 5 + [20.0] * (SIZE[1] - 5)


@pytest.mark.parametrize("kind", ["i2", "i4", "i8", "u4", "u8"])
def test_whole_numbers_of_any_width(kind: str, tmp_path: Path) -> None:
    """Codes above 2**24 keep their steps; negative ones are unknown."""
    values = np.full(SIZE, 20_000 if kind == "i2" else 1_000_000_001, kind)
    if kind[0] == "i":
        values[0, 0] = -5
    folder(tmp_path, lambda path: np.save(path, values))
    unit = 50 / float(values[1, 1])
    item = FolderFrames(tmp_path, ["a"], "{}.png", "{}_depth.npy", unit, 100.0, normals="none")[0]
    assert item["depth"][0, 1, 1].item() == pytest.approx(50, rel=1e-6)
    assert item["mask"][0, 0, 0].item() == (kind[0] == "u")


def folder(root: Path, write: Callable[[Path], Any], count: int = 1) -> None:
    lens = {"model": "pinhole", "size": list(SIZE), "fx": 30.0, "fy": 30.0, "cx": 15.5, "cy": 11.5}
    (root / "camera.json").write_text(json.dumps(lens))
    (root / "a").mkdir()
    for number in range(count):
        cv2.imwrite(str(root / "a" / f"{number:04d}.png"), np.full((*SIZE, 3), 90, np.uint8))
        write(root / "a" / f"{number:04d}_depth.npy")


def test_channels_that_differ_are_refused_before_anything_is_read(tmp_path: Path) -> None:
    folder(tmp_path, lambda path: np.save(path, xyz(STEPS)), count=3)
    layout: dict[str, Any] = {
        "image": "{}.png",
        "depth": "{}_depth.npy",
        "depth_unit": 1.0,
        "max_depth": 100.0,
    }
    with refused(DataError, tmp_path / "a" / "0000_depth.npy", "one channel", "got 3"):
        FolderFrames(tmp_path, ["a"], **layout, normals="none")
    frames = FolderFrames(tmp_path, ["a"], **layout, normals="none", depth_channel=2)
    assert (frames[2]["depth"][0].numpy() == STEPS).all()
    plain = FolderFrames(tmp_path, [], **layout, normals="none")
    assert frames.decoding() == plain.decoding() | {"depth_channel": 2}

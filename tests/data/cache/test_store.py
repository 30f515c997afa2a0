"""A store gives the numbers of the files, bit by bit; what is not whole or has changed is noticed."""

import io
import json
import math
import os
import pickle
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.lib import format as npy
from refusals import refused
from torch.utils.data import DataLoader

from col3d.data.cache import Recipe, Stored, StoredVideo, read_video
from col3d.data.cache import read as reading
from col3d.data.cache import write_video as write_store
from col3d.data.cache.index import Shard
from col3d.data.datamodule import FrameDataModule
from col3d.data.datasets.c3vd import C3VD
from col3d.data.sized import Resized
from col3d.errors import DataError
from col3d.geometry import OmnidirectionalCamera, angle_between
from col3d.geometry.camera_file import plain_from_camera

SIZE = (48, 64)
Make = Callable[..., tuple[Resized, StoredVideo]]


@pytest.fixture
def make(write_video: Any, lens: Any, tmp_path: Path) -> Make:
    """Files of a video, and the store of them."""

    def make(normals: str = "stored", release: str = "current") -> tuple[Resized, StoredVideo]:
        root = write_video(numbers=(0, 1, 2, 7), release=release)
        frames = Resized(C3VD(root, ["cecum_t1_a"], normals=normals, camera=lens), SIZE)
        write_store(tmp_path / "store", frames, recipe_of(frames, normals), lambda: None)
        stored = read_video(tmp_path / "store" / "cecum_t1_a")
        assert stored is not None
        return frames, stored

    return make


def recipe_of(frames: Resized, normals: str) -> Recipe:
    return Recipe("c3vd", SIZE, normals, 100.0, frames.cameras[0])


def stored_frames(stored: StoredVideo) -> Stored:
    return Stored([(stored, stored.frames)])


@pytest.mark.parametrize("normals", ["stored", "derived", "none"])
@pytest.mark.parametrize("release", ["current", "pre_2023_05"])
def test_a_store_gives_the_numbers_of_the_files(make: Make, normals: str, release: str) -> None:
    frames, stored = make(normals, release)
    prepared = stored_frames(stored)
    assert stored.release == release
    assert len(prepared) == len(frames) == 4
    for index in range(4):
        found, expected = prepared[index], frames[index]
        assert set(found) == set(expected)
        assert (found["video"], int(found["frame"])) == ("cecum_t1_a", (0, 1, 2, 7)[index])
        for key in set(found) - {"video"}:
            assert torch.equal(found[key], expected[key]), key


def test_codes_are_within_their_tolerance_of_the_files(make: Make) -> None:
    frames, stored = make()
    exact, found = frames.resize(frames.frames[1]), stored_frames(stored)[1]
    known = exact["mask"]
    assert torch.equal(found["mask"], known)
    assert torch.equal(found["image"], exact["image"])
    assert (found["depth"] - exact["depth"]).abs().max() < 0.0008
    assert angle_between(found["normals"], exact["normals"])[known].max() < 0.004 + 1e-3


def test_frames_are_chosen_by_number(make: Make) -> None:
    frames, stored = make()
    few = Stored([(stored, [7, 1])])
    assert [int(few[index]["frame"]) for index in range(2)] == [7, 1]
    assert torch.equal(few[0]["depth"], frames[3]["depth"])
    assert few.codes([1, 0, 1])["frame"].tolist() == [1, 7, 1]


@pytest.mark.parametrize("workers", [0, 2])
def test_batches_of_a_loader_are_those_of_the_files(make: Make, workers: int) -> None:
    frames, stored = make()
    for sized in (frames, stored_frames(stored)):
        module = FrameDataModule({"val": sized}, batch_size=3, workers=workers)
        codes = list(module.val_dataloader())
        assert [len(batch["frame"]) for batch in codes] == [3, 1]
        assert codes[0]["image"].dtype == torch.uint8
        assert codes[0]["image"].is_shared() == (workers > 0)
        batch = module.on_after_batch_transfer(codes[0], 0)
        for row in range(3):
            assert torch.equal(batch["depth"][row], frames[row]["depth"])
            assert torch.equal(batch["normals"][row], frames[row]["normals"])  # type: ignore[typeddict-item]
            assert torch.equal(batch["rays"][row], frames[row]["rays"])


def test_maps_are_opened_late_and_never_pickled(make: Make) -> None:
    _, stored = make()
    prepared = stored_frames(stored)
    assert not prepared.maps
    _ = prepared[0]
    assert len(prepared.maps) == 4
    pickled = pickle.dumps(prepared)
    assert len(pickled) < 20_000
    again = pickle.loads(pickled)
    assert not again.maps
    assert torch.equal(again[2]["depth"], prepared[2]["depth"])


def test_pages_are_given_back(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    _, stored = make()
    prepared, given_back = stored_frames(stored), []

    def note(self: Any) -> None:
        given_back.append(self)

    monkeypatch.setattr(reading._Map, "give_pages_back", note)
    monkeypatch.setattr(reading, "RELEASE_BYTES", 3 * 10 * SIZE[0] * SIZE[1] - 1)
    for expected in (0, 0, 4, 4, 4, 8):
        _ = prepared.codes([0])
        assert len(given_back) == expected


def test_frames_read_after_pages_were_given_back_are_the_same(make: Make) -> None:
    frames, stored = make()
    prepared = stored_frames(stored)
    _ = prepared[0]
    for opened in prepared.maps.values():
        opened.give_pages_back()
    assert torch.equal(prepared[0]["depth"], frames[0]["depth"])


@pytest.mark.parametrize("name", ["image", "depth", "normals", "mask"])
def test_a_truncated_array_is_found_at_opening(make: Make, name: str) -> None:
    _, stored = make()
    path = stored.folder / f"{name}.npy"
    path.write_bytes(path.read_bytes()[:-1])
    with refused(DataError, path, "bytes", "col3d prepare"):
        stored_frames(stored)


def test_another_header_is_found_at_opening(make: Make) -> None:
    _, stored = make()
    path = stored.folder / "depth.npy"
    content = bytearray(path.read_bytes())
    content[20] ^= 1
    path.write_bytes(content)
    with refused(DataError, path, "begin"):
        stored_frames(stored)
    path.unlink()
    with refused(DataError, path, "missing"):
        stored_frames(stored)


def test_a_changed_byte_is_found_by_the_checksum(make: Make) -> None:
    _, stored = make()
    assert stored.damaged() == []
    path = stored.folder / "normals.npy"
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(content)
    stored.check()
    assert stored.damaged() == [path]


def test_a_changed_source_is_noticed(make: Make) -> None:
    frames, stored = make()
    source = frames.frames
    assert stored.stale(source.root, source.frames) == ""
    path = source.frames[2].files["depth"]
    path.write_bytes(path.read_bytes())
    assert stored.stale(source.root, source.frames) == f"{path} has changed since"
    fewer = StoredVideo(**{**stored.__dict__, "frames": stored.frames[:2]})
    assert "frame 2 of cecum_t1_a has come since" in fewer.stale(source.root, source.frames)


def test_a_recipe_says_in_what_it_differs(make: Make, lens: Any) -> None:
    frames, stored = make()
    recipe = recipe_of(frames, "stored")
    assert stored.differs(recipe) == ""
    other = Recipe("phantom", (64, 64), "stored", 100.0, lens.resized((64, 64)))
    assert stored.differs(other) == (
        "data is c3vd, not phantom, size is [48, 64], not [64, 64], "
        "another camera, of another size_hw and centre and stretch"
    )


def test_frames_prepared_through_the_transposed_lens_are_stale(make: Make, lens: Any) -> None:
    """Those of before the stretch matrix of C3VD's lens was corrected."""
    frames, stored = make()
    before = OmnidirectionalCamera.c3vd().stretch_forms()["[[c, d], [e, 1]]"]
    before = before.resized(lens.size_hw).resized(SIZE)
    recipe = {**stored.recipe, "camera": plain_from_camera(before)}
    earlier = StoredVideo(**{**stored.__dict__, "recipe": recipe})
    assert earlier.differs(recipe_of(frames, "stored")) == "another camera, of another stretch"


def test_arrays_are_plain_numpy_files(make: Make) -> None:
    _, stored = make()
    shapes = {"image": (4, 3, 48, 64), "depth": (4, 48, 64), "normals": (4, 2, 48, 64), "mask": (4, 48, 64)}
    types = {"image": np.uint8, "depth": np.uint16, "normals": np.int16, "mask": np.bool_}
    for name, shape in shapes.items():
        array = np.load(stored.folder / f"{name}.npy", mmap_mode="r")
        assert (array.shape, array.dtype) == (shape, np.dtype(types[name]))
    index = json.loads((stored.folder / "index.json").read_text())
    assert index["size"] == [48, 64]
    assert index["release"] == "current"
    assert len(index["sources"]) == 12
    assert stored.camera.size_hw == SIZE


def test_an_unreadable_index_is_no_store(make: Make) -> None:
    _, stored = make()
    for content in ("", "{", "[]", '{"video": 1}'):
        (stored.folder / "index.json").write_text(content)
        assert read_video(stored.folder) is None


def test_a_video_that_fails_leaves_nothing(make: Make, tmp_path: Path) -> None:
    frames, _ = make()
    path = frames.frames.frames[3].files["depth"]
    path.write_bytes(path.read_bytes()[:5000])
    with refused(DataError, path):
        write_store(tmp_path / "other", frames, recipe_of(frames, "stored"), lambda: None)
    assert list((tmp_path / "other").iterdir()) == []


def test_spawned_workers_open_maps_of_their_own(make: Make, tmp_path: Path) -> None:
    frames, stored = make()
    prepared = stored_frames(stored)
    loader = DataLoader(prepared, batch_size=None, num_workers=1, multiprocessing_context="spawn")
    found = [item["depth"] for item in loader]
    assert all(torch.equal(one, frames[index]["depth"]) for index, one in enumerate(found))
    assert not prepared.maps


@pytest.mark.skipif("COL3D_C3VD_SAMPLE" not in os.environ, reason="it names no folder of real frames")
@pytest.mark.parametrize("folder", ["sample_current", "sample_pre_2023_05"])
def test_real_frames_are_the_same_from_a_store(folder: str, tmp_path: Path) -> None:
    frames = C3VD(Path(os.environ["COL3D_C3VD_SAMPLE"]) / folder, ["unknown_frame"])
    raw = Resized(frames, (320, 320))
    recipe = Recipe("c3vd", (320, 320), "stored", 100.0, raw.cameras[0])
    write_store(tmp_path, raw, recipe, lambda: None)
    stored = read_video(tmp_path / "unknown_frame")
    assert stored is not None
    found, same, exact = stored_frames(stored)[0], raw[0], raw.resize(frames[0])
    known = exact["mask"]
    assert known.float().mean() > 0.85
    for key in ("image", "depth", "normals", "mask", "rays"):
        assert torch.equal(found[key], same[key]), key
    assert torch.equal(found["mask"], known)
    assert torch.equal(found["image"], exact["image"])
    assert (found["depth"] - exact["depth"]).abs().max() < 0.0008
    assert angle_between(found["normals"], exact["normals"])[known].max() < 0.004 + 1e-3


READ_ALL = """
import sys
from pathlib import Path
from col3d.data.cache import Stored, read_video
from col3d.data.cache import read
read.RELEASE_BYTES = int(sys.argv[2])
stored = read_video(Path(sys.argv[1]))
frames = Stored([(stored, stored.frames)])
frames.codes([0])
def pages():
    return int(Path("/proc/self/statm").read_text().split()[1])
before, most = pages(), 0
for first in range(0, len(frames), 8):
    frames.codes(range(first, first + 8))
    most = max(most, pages())
print((most - before) * 4)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux's view of a process")
@pytest.mark.parametrize(("release_bytes", "flat"), [(8 << 20, True), (1 << 40, False)])
def test_memory_of_a_reader_stays_flat(make: Make, release_bytes: int, flat: bool) -> None:
    """Over 160 frames of 1 MB, most of them holes in the files; without giving pages back it would not."""
    _, stored = make("none")
    header = io.BytesIO()
    shape = (160, 3, 592, 592)
    npy.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": shape})
    with (stored.folder / "image.npy").open("wb") as file:
        file.write(header.getvalue())
        file.truncate(len(header.getvalue()) + math.prod(shape))
    size, crc = (stored.folder / "image.npy").stat().st_size, zlib.crc32(header.getvalue())
    shard = Shard(shape, "|u1", len(header.getvalue()), size, crc, 0)
    replace(stored, frames=tuple(range(160)), shards={"image": shard}).write()
    command = [sys.executable, "-c", READ_ALL, str(stored.folder), str(release_bytes)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    grown_by = int(done.stdout) / 1024
    assert grown_by < 60 if flat else grown_by > 120, "megabytes"

"""The measurements run and are what they say; no test holds them to a time."""

import json
import math
from pathlib import Path

import pytest
import torch
from refusals import refused

from benchmarks.bare_copy import BareCopy
from benchmarks.frames import frames_of, prepared, repeated
from benchmarks.published_loader import MEAN, STD, PublishedLoader
from benchmarks.report import ratios_of, regressions, row
from benchmarks.speed import BASELINE, main
from benchmarks.timing import Spread, interleaved, rates, ratios, spread_of
from benchmarks.worker_memory import worker_memory
from col3d.data.cache import Stored, StoredVideo
from col3d.data.datasets.frame_set import FrameSet
from col3d.errors import DataError

pytestmark = pytest.mark.end_to_end

FULL_HW, SIZE_HW = (64, 80), (32, 40)


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("speed")


@pytest.fixture
def parts(cache: Path) -> list[FrameSet]:
    return frames_of("phantom", None, cache, FULL_HW, 4)


@pytest.fixture
def videos(parts: list[FrameSet], tmp_path: Path) -> list[StoredVideo]:
    return prepared(parts, tmp_path / "store", SIZE_HW, 11)


def test_all_is_measured_and_written(cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "speed.json"
    tiny = "--frames 4 --epoch 10 --repeats 1 --workers 1 --batch-size 2 --size 32 40 --full-size 64 80"
    rows = main(["--only", "data", *tiny.split(), "--cache", str(cache), "--json", str(path)])
    names = {line.name for line in rows}
    speeds = {"store", "store, decoded", "raw", "raw, decoded", "stand-in", "copy", "copy, no loader"}
    compared = {"store / stand-in", "raw / stand-in", "copy / store", "growth after a tenth"}
    assert speeds | compared <= names
    assert len(names) == len(rows)
    assert {line.name for line in rows if line.met is not None} > compared
    assert all(math.isfinite(line.spread.median) for line in rows)
    assert all(line.spread.low <= line.spread.median <= line.spread.high for line in rows)
    said = capsys.readouterr().out
    assert all(name in said for name in names)
    written = json.loads(path.read_text())
    assert [line["name"] for line in written["rows"]] == [line.name for line in rows]
    assert not list(cache.glob("store-*"))


def test_the_stand_in_gives_what_a_network_takes(parts: list[FrameSet]) -> None:
    item = PublishedLoader(parts[0], SIZE_HW)[1]
    shapes = {"image": (3, *SIZE_HW), "depth": (1, *SIZE_HW), "normals": (3, *SIZE_HW)}
    assert {name: tuple(values.shape) for name, values in item.items()} == shapes
    assert {values.dtype for values in item.values()} == {torch.float32}


def test_the_stand_in_sees_the_same_frame(parts: list[FrameSet]) -> None:
    item, truth = PublishedLoader(parts[0], FULL_HW, degrees=0.0, chance=0.0)[1], parts[0][1]
    mean, std = (torch.tensor(values)[:, None, None] for values in (MEAN, STD))
    torch.testing.assert_close(item["image"] * std + mean, truth["image"])
    torch.testing.assert_close(item["depth"][truth["mask"]], truth["depth"][truth["mask"]])
    inside = truth["mask"].expand(3, -1, -1)
    torch.testing.assert_close(item["normals"][inside], truth["normals"][inside], atol=1e-4, rtol=0)


def test_the_bare_copy_has_the_bytes_of_the_store(videos: list[StoredVideo]) -> None:
    stored = Stored([(video, video.frames) for video in videos])
    bare = BareCopy([(video.folder, len(video.frames)) for video in videos])
    assert len(bare) == len(stored) >= 11
    indices = [0, 5, 10, 3]
    copied, codes = bare.__getitems__(indices), stored.codes(indices)
    for name, values in copied.items():
        assert torch.equal(values, codes[name])  # type: ignore[literal-required]


def test_short_data_is_repeated(parts: list[FrameSet]) -> None:
    frames = repeated(parts, 7)
    assert [frame.number for frame in frames.frames] == [0, 1, 0, 1, 0, 1, 0]
    assert [frame.video[0] for frame in frames.frames] == list("ccttcct")
    assert len(parts[0]) == 2
    assert frames[6]["video"] == "trans_t1_a"


def test_real_frames_need_a_root_with_normals(tmp_path: Path, cache: Path) -> None:
    with refused(DataError, "ROOT", "needed"):
        frames_of("c3vd", None, cache, FULL_HW, 4)
    (tmp_path / "cecum_t1_a").mkdir()
    with refused(DataError, None, tmp_path, "normals"):
        frames_of("c3vd", tmp_path, cache, FULL_HW, 4)


def test_what_is_compared_takes_turns() -> None:
    calls: list[str] = []
    works = {name: lambda name=name: calls.append(name) for name in "ab"}  # type: ignore[misc]
    seconds = interleaved(works, 3)
    assert "".join(calls) == "abababab"
    assert [len(taken) for taken in seconds.values()] == [3, 3]


def test_numbers_of_repeats() -> None:
    assert spread_of([3.0, 1.0, 2.5]) == Spread(median=2.5, low=1.0, high=3.0)
    assert rates(6, [1.0, 3.0]) == [6.0, 2.0]
    assert ratios([2.0, 9.0], [1.0, 3.0]) == [2.0, 3.0]


def test_the_rest_is_measured_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "speed.json"
    parts = ["floors", "networks", "metrics", "geometry", "pieces", "startup"]
    rows = main(["--smoke", "--json", str(path), "--only", *parts])
    assert all(math.isfinite(line.spread.median) and line.spread.median > 0 for line in rows)
    assert {"col3d_mtl / encoder", "newcrfs / its twin", "published / col3d", "train.py --help"} <= {
        line.name for line in rows
    }
    assert json.loads(path.read_text())["machine"]["cores"] > 0
    assert "0 ratios have become worse" in capsys.readouterr().out


def test_the_baseline_is_of_ratios_that_are_measured() -> None:
    baseline = json.loads(BASELINE.read_text())["ratios"]
    assert any("col3d_mtl / encoder" in name for name in baseline)
    assert all(ratio > 0 for ratio in baseline.values())


@pytest.mark.parametrize(("target", "worse"), [("at_least", 0.8), ("at_most", 1.2)])
def test_what_has_become_slower_is_told(target: str, worse: float) -> None:
    before = [row("Table", "a / b", "x", [1.0], **{target: 1.0}), row("Table", "a", "ms", [1.0])]
    baseline = ratios_of(before)
    assert baseline == {"Table: a / b": 1.0}
    for now, slower in ((worse, True), (1 / worse, False), (1.1, False), (0.9, False)):
        rows = [row("Table", "a / b", "x", [now], **{target: 1.0}), row("Table", "new", "x", [9.0])]
        assert bool(regressions(rows, baseline)) == slower


def test_targets_hold_the_median() -> None:
    lines = [row("", "", "", [2.0, 4.0, 9.0], **kind) for kind in ({"at_least": 4}, {"at_most": 3}, {})]
    assert [line.verdict for line in lines] == ["at least 4: met", "at most 3: MISSED", ""]


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="no /proc")
def test_a_workers_memory_is_told(videos: list[StoredVideo]) -> None:
    memory = worker_memory(videos, 1)
    assert memory is not None
    assert len(memory.tenths) == 10
    assert 0 < memory.tenths[0] <= memory.largest

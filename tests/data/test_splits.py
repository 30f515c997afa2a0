"""The paper's split, its labels, ranges of frames, and counts."""

import pytest
from refusals import refused

from col3d.data.datasets.videos import describe, video_table
from col3d.data.splits import (
    SPLITS,
    Selection,
    check_counts,
    paper_split,
    parse_selection,
    selection_of_any_video,
)
from col3d.errors import DataError


def test_the_papers_numbers_of_frames() -> None:
    split = paper_split()
    counts = {name: sum(video_table()[video].frames for video in split[name]) for name in SPLITS}
    assert counts == {"train": 6244, "val": 1738, "test": 1268}
    assert sum(video.frames for video in video_table().values()) == 10015
    assert len(video_table()) == 22


def test_each_video_is_in_one_part() -> None:
    listed = [video for videos in paper_split().values() for video in videos]
    assert len(listed) == len(set(listed)) == 21
    assert set(video_table()) - set(listed) == {"cecum_t1_b"}
    assert paper_split()["test"] == ["cecum_t2_a", "desc_t4_a", "sigmoid_t3_b", "trans_t3_b"]


def test_every_label_is_its_video() -> None:
    labels = {video.label: video.name for video in video_table().values() if video.label}
    assert len(labels) == 21
    for label, name in labels.items():
        assert parse_selection(label) == Selection(name)
        assert parse_selection(f"{label}:3-5") == parse_selection(f"{name}:3-5")
    assert parse_selection("t3v1") == parse_selection("t4v1") == Selection("trans_t4_a")


def test_ranges_hold_both_ends() -> None:
    selection = parse_selection("cecum_t1_a:0-120")
    assert selection == Selection("cecum_t1_a", 0, 120)
    assert [frame in selection for frame in (0, 60, 120, 121)] == [True, True, True, False]
    one = parse_selection("c1v1:7-7")
    assert [frame for frame in range(20) if frame in one] == [7]
    assert all(frame in parse_selection("c1v1") for frame in (0, 10**6))


@pytest.mark.parametrize(
    "entry",
    ["", ":", ":0-3", "cecum_t1_a:", "cecum_t1_a:5", "cecum_t1_a:5-", "cecum_t1_a:-5", "cecum_t1_a:a-b",
     "cecum_t1_a:0-1:2-3", "cecum_t1_a:1.0-2", "cecum_t1_a: 0-3", "cecum_t1_a:0--3"],
)  # fmt: skip
def test_malformed_ranges(entry: str) -> None:
    with refused(DataError, None, f"split entry {entry!r}: ", "VIDEO:FIRST-LAST"):
        parse_selection(entry)


def test_ends_in_the_wrong_order() -> None:
    with refused(DataError, "split entry 'cecum_t1_a:9-8'", "first", "last"):
        parse_selection("cecum_t1_a:9-8")


def test_unknown_videos() -> None:
    with refused(DataError, None, "'cecum_t1_x'", "'cecum_t1_"):
        parse_selection("cecum_t1_x", present=["other"])
    with refused(DataError, None, "'my_own_video'"):
        parse_selection("my_own_vide:0-3", present=["my_own_video"])
    assert parse_selection("my_own_video:0-3", present=["my_own_video"]) == Selection("my_own_video", 0, 3)


def test_a_video_of_any_name() -> None:
    assert selection_of_any_video("my_own_video:0-3") == Selection("my_own_video", 0, 3)
    assert selection_of_any_video("c1v1") == Selection("cecum_t1_a")
    with refused(DataError, None, "'my_own_video:3'", "VIDEO:FIRST-LAST"):
        selection_of_any_video("my_own_video:3")


def test_what_a_video_shows() -> None:
    assert describe("trans_t2_c") == ("transverse", "2")
    assert describe("my_own_video") == ("", "")


def test_counts_of_whole_videos() -> None:
    both = ["c0_cecum_t1_v1", "sigmoid_t1_a"]
    check_counts(both, {"cecum_t1_a": 276, "sigmoid_t1_a": 700}, "current")
    check_counts(both, {"cecum_t1_a": 276, "sigmoid_t1_a": 800}, "pre_2023_05")
    check_counts(["c1_cecum_t1_v1", "mine"], {"c1_cecum_t1_v1": 218, "mine": 7}, "current")
    check_counts(["c1v1:0-9", "cecum_t1_a:20-29"], {"cecum_t1_a": 20}, "current")
    with refused(DataError, None, "sigmoid_t1_a has 700 frames", "pre_2023_05 ", 800):
        check_counts(both, {"cecum_t1_a": 276, "sigmoid_t1_a": 700}, "pre_2023_05")
    with refused(DataError, None, "cecum_t1_a has 275 frames", 276, "data.allow_missing"):
        check_counts(both, {"cecum_t1_a": 275}, "current")
    with refused(DataError, None, "cecum_t1_a:0-9 has 9 frames", 10):
        check_counts(["c1v1:0-9"], {"cecum_t1_a": 9}, "current")


def test_table_is_that_of_the_data_set() -> None:
    """Names say segment and texture; nothing else in the table may contradict them."""
    short = {"cecum": "cecum", "descending": "desc", "sigmoid": "sigmoid", "transverse": "trans"}
    for name, video in video_table().items():
        assert name == f"{short[video.segment]}_t{video.texture}_{name[-1]}"
        if video.label:
            assert video.label.startswith(f"{short[video.segment][0]}{video.texture}v")

"""The table of C3VD's and C3VDv2's videos, and their names of then and of today."""

from collections import Counter

import pytest

from col3d.data.datasets.videos import (
    canonical_name,
    catalogue,
    describe,
    frames_of,
    other_names,
    seeded_name,
    video_table,
)
from col3d.data.splits import Selection, expand, parse_selection, selection_of_any_video


def test_how_many_there_are_of_each_kind() -> None:
    counts = Counter((video.data, video.kind) for video in catalogue().values())
    assert counts == {
        ("c3vd", "registered"): 22,
        ("c3vd", "screening"): 4,
        ("c3vdv2", "registered"): 169,
        ("c3vdv2", "deformation"): 15,
        ("c3vdv2", "screening"): 8,
    }
    assert len(video_table()) == 22
    assert sum(video.frames for video in catalogue().values() if video.kind == "registered") == 10015 + 67886


def test_names_of_today_say_what_a_video_shows() -> None:
    segments = {"desc": "descending", "trans": "transverse"}
    for video in catalogue().values():
        colon, segment, texture, number = video.released_as.split("_")
        assert (colon, segment, texture) == (video.colon, video.segment, f"t{video.texture}")
        assert (video.data == "c3vd") == (colon == "c0")
        if video.data == "c3vd" and video.has_truth:
            short, old_texture, letter = video.name.split("_")
            assert segments.get(short, short) == segment
            assert (old_texture, number) == (texture, f"v{'abc'.index(letter) + 1}")
        if video.kind == "deformation":
            assert number == "v4"


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("c0_cecum_t1_v1", "cecum_t1_a"),
        ("c0_cecum_t1_v3", "c0_cecum_t1_v3"),  # there is none
        ("c0_descending_t4_v1", "desc_t4_a"),
        ("c0_sigmoid_t3_v2", "sigmoid_t3_b"),
        ("c0_transverse_t1_v1", "trans_t1_a"),
        ("c0_full_t2_v1", "screening_t2"),
        ("c1v1", "cecum_t1_a"),
        ("t3v1", "trans_t4_a"),
        ("cecum_t1_a", "cecum_t1_a"),
        ("c1_cecum_t1_v1", "c1_cecum_t1_v1"),
        ("c0_cecum_t1_v1_s7", "cecum_t1_a_s7"),
        ("my_video_s3", "my_video_s3"),
        ("", ""),
    ],
)
def test_every_name_means_its_video(given: str, name: str) -> None:
    assert canonical_name(given) == name
    assert canonical_name(name) == name


def test_no_two_videos_share_a_name() -> None:
    assert len(other_names()) == 26 + 21 + 1
    assert not set(other_names()) & set(catalogue())


def test_entries_take_every_name() -> None:
    for video in video_table().values():
        for given in filter(None, (video.name, video.released_as, video.label)):
            assert parse_selection(given) == Selection(video.name)
            assert parse_selection(f"{given}:2-7") == Selection(video.name, 2, 7)
            assert selection_of_any_video(given) == Selection(video.name)
            assert describe(given) == (video.segment, video.texture)
    assert seeded_name(canonical_name("c0_desc_t4_a_s2"), 0) == ("c0_desc_t4_a_s2", 0)


def test_wildcards_match_either_name_and_no_video_without_truth() -> None:
    present = [
        "cecum_t1_a",
        "trans_t1_a",
        "screening_t1",
        "c1_cecum_t1_v1",
        "c1_cecum_t1_v4",
        "c1_full_t1_v1",
    ]
    assert expand(["cecum_*"], present) == ["cecum_t1_a"]
    assert expand(["c0_*"], present) == ["cecum_t1_a", "trans_t1_a"]
    assert expand(["c1_*"], present) == ["c1_cecum_t1_v1"]


def test_frames_of_a_video() -> None:
    assert (frames_of("sigmoid_t1_a"), frames_of("sigmoid_t1_a", "pre_2023_05")) == (700, 800)
    assert frames_of("c1_ascending_t1_v1") == 282
    assert frames_of("mine") is None

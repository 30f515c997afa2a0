"""Splits that leave a segment or a texture out, and what test videos share with training."""

from pathlib import Path

import pytest
import yaml
from refusals import refused
from tiny_run import composed

from col3d.data.datasets.videos import describe, video_table
from col3d.data.leakage import shared_with_training
from col3d.data.splits import leave_out, paper_split, parse_selection
from col3d.errors import DataError

SPLITS = Path(__file__).parents[2] / "conf" / "data" / "split"
NINE = ((1, "a"), (1, "b"), (2, "a"), (2, "b"), (2, "c"), (3, "a"), (3, "b"), (4, "a"), (4, "b"))
FOLDS = [(kind, value) for kind, of_video in (("segment", 0), ("texture", 1)) for value in
         dict.fromkeys(describe(video)[of_video] for video in video_table())]  # fmt: skip


def test_rendered_videos_of_other_seeds_share_nothing() -> None:
    rows = shared_with_training(["cecum_t1_a_s0", "cecum_t1_b_s3"], ["cecum_t1_a_s1", "cecum_t1_a_s3"])
    assert [row.worst for row in rows] == ["nothing", "phantom and texture"]
    assert [row.worst for row in shared_with_training(["cecum_t1_a_s0"], ["cecum_t1_a"])] == [
        "the video itself"
    ]


@pytest.mark.parametrize(("kind", "value"), FOLDS)
def test_a_fold_has_a_name(kind: str, value: str) -> None:
    name = f"leave_{value}_out" if kind == "segment" else f"leave_texture_{value}_out"
    given = composed("train", f"data/split={name}", "output_dir=x")["data"]["split"]
    assert given == {"name": name, **leave_out(kind, value)}


@pytest.mark.parametrize(("kind", "value"), FOLDS)
def test_a_fold_tests_on_all_of_it_and_learns_from_none(kind: str, value: str) -> None:
    split = leave_out(kind, value)
    assert sorted(v for part in split.values() for v in part) == sorted(video_table())
    of_it = {v.name for v in video_table().values() if getattr(v, kind) == value}
    assert set(split["test"]) == of_it
    for row in shared_with_training(split["train"], split["test"]):
        assert row.of_video == row.of_surface == ()
        assert (row.of_phantom if kind == "segment" else row.of_texture) == ()


def test_there_are_four_folds_of_either_kind() -> None:
    assert [kind for kind, _ in FOLDS] == ["segment"] * 4 + ["texture"] * 4
    assert len(list(SPLITS.glob("leave_*.yaml"))) == 8


def test_what_the_paper_s_test_videos_share() -> None:
    split = paper_split()
    rows = {row.video: row for row in shared_with_training(split["train"], split["test"])}
    assert {video: row.worst for video, row in rows.items()} == {
        "cecum_t2_a": "phantom and texture",
        "desc_t4_a": "the texture",
        "sigmoid_t3_b": "the phantom",
        "trans_t3_b": "phantom and texture",
    }
    assert rows["cecum_t2_a"].of_surface == ("cecum_t2_b", "cecum_t2_c")


PAPERS = {
    "ppsnet": {
        "desc_t4_a": "the video itself",
        "cecum_t1_a": "phantom and texture",
        "cecum_t2_a": "phantom and texture",
        "cecum_t3_a": "the phantom",
        "sigmoid_t3_a": "phantom and texture",
        "trans_t2_a": "phantom and texture",
        "trans_t3_a": "phantom and texture",
        "trans_t4_a": "phantom and texture",
    },
    "transverse_out": {f"trans_t{texture}_{video}": "the texture" for texture, video in NINE},
    "endoomni": {},
}


@pytest.mark.parametrize("name", PAPERS)
def test_splits_of_other_papers(name: str) -> None:
    split = yaml.safe_load((SPLITS / f"{name}.yaml").read_text())
    assert split.pop("name") == name
    chosen = {part: [parse_selection(entry) for entry in entries] for part, entries in split.items()}
    pieces = [selection for part in chosen.values() for selection in part]
    frames = [(s.video, n) for s in pieces for n in range(video_table()[s.video].frames) if n in s]
    assert len(frames) == len(set(frames))  # none is in two parts
    rows = shared_with_training(split["train"], split["test"])
    assert {row.video: row.worst for row in rows} == PAPERS[name]


def test_what_other_papers_train_on() -> None:
    counts = {}
    for name in PAPERS:
        split = yaml.safe_load((SPLITS / f"{name}.yaml").read_text())
        del split["name"]
        counts[name] = {
            part: sum(
                number in parse_selection(entry)
                for entry in entries
                for number in range(video_table()[parse_selection(entry).video].frames)
            )
            for part, entries in split.items()
        }
    assert counts == {
        "ppsnet": {"train": 7126, "val": 0, "test": 2889},
        "transverse_out": {"train": 6130, "val": 1149, "test": 2736},
        "endoomni": {"train": 8742, "val": 1273, "test": 0},
    }


def test_videos_of_c3vdv2_share_walls_within_a_colon_alone() -> None:
    rows = shared_with_training(
        ["c1_cecum_t1_v1", "c2_cecum_t2_v2"], ["c1_cecum_t1_v2", "c1_cecum_t2_v1", "c2_cecum_t1_v2"]
    )
    assert [row.worst for row in rows] == ["phantom and texture", "the phantom", "the phantom"]
    (row,) = shared_with_training(["c1_cecum_t1_v1"], ["c2_cecum_t1_v2"])
    assert row.worst == "the texture"


def test_frames_of_one_video_on_both_sides_are_told() -> None:
    rows = shared_with_training(["cecum_t1_a:0-9", "mine"], ["c1v1:20-30", "mine", "other"])
    assert [row.worst for row in rows] == ["the video itself", "the video itself", "nothing"]


def test_nothing_to_leave_out() -> None:
    with refused(DataError, "split", "segment", "'rectum'"):
        leave_out("segment", "rectum")

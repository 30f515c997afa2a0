"""The table of frames: there and back, means, groups, and what is refused."""

import math
from pathlib import Path

import pytest
from fake_runs import DEPTH_METRICS, METRICS
from refusals import refused

from col3d.registry.metric_specs import OURS, MetricSpec
from col3d.reports.per_frame import (
    IDENTITY,
    Row,
    by_video,
    means,
    metrics_in,
    read_per_frame,
    write_per_frame,
)


def row(video: str, frame: int, **values: float) -> dict[str, str | int | float]:
    facts = {
        "model": "bts",
        "seed": 0,
        "data": "phantom",
        "split": "test",
        "segment": "cecum",
        "texture": "1",
    }
    return {**facts, "video": video, "frame": frame, "protocol": "standard", **values}


def test_there_and_back_to_the_last_digit(tmp_path: Path) -> None:
    values = {name: 1 / (3 + i) for i, name in enumerate(METRICS)}
    rows = [row("a, quoted", 0, **values), row("b", 7, abs_rel=math.pi)]
    write_per_frame(tmp_path / "per_frame.csv", rows)
    found = read_per_frame(tmp_path / "per_frame.csv")
    assert list(found[0]) == [*IDENTITY, *OURS, "pixels"]
    assert {name: float(found[0][name]) for name in METRICS} == values
    assert (found[0]["video"], found[1]["frame"]) == ("a, quoted", "7")
    assert [name for name in METRICS if found[1][name] != ""] == ["abs_rel"]
    assert means(found) == means(rows)
    assert [path.name for path in tmp_path.iterdir()] == ["per_frame.csv"]


def test_a_failed_write_leaves_the_old_table(tmp_path: Path) -> None:
    path = tmp_path / "per_frame.csv"
    write_per_frame(path, [row("a", 0, abs_rel=0.5)])
    before = path.read_bytes()
    with refused(ValueError, None, "surprise"):
        write_per_frame(path, [row("b", 0), row("c", 0, surprise=1.0)])
    assert path.read_bytes() == before


@pytest.mark.parametrize("lost", IDENTITY)
def test_a_missing_column_is_named(tmp_path: Path, lost: str) -> None:
    path = tmp_path / "per_frame.csv"
    path.write_text(",".join(name for name in (*IDENTITY, *METRICS) if name != lost) + "\n")
    with refused(ValueError, path, f"columns {lost} "):
        read_per_frame(path)
    path.write_text("")
    with refused(ValueError, path, ", ".join(IDENTITY)):
        read_per_frame(path)


def test_metrics_may_be_missing_and_unknown(tmp_path: Path) -> None:
    path = tmp_path / "per_frame.csv"
    cells = {**row("a", 0), "sharpness": "0.5", "rmse": "2.0", "pixels": "7"}
    path.write_text(",".join(cells) + "\n" + ",".join(map(str, cells.values())) + "\n")
    found = read_per_frame(path)
    assert metrics_in(found) == ["rmse", "sharpness"]
    assert means(found) == {"rmse": 2.0, "sharpness": 0.5}
    assert means(found, "pixel") == {"rmse": 2.0}


def test_a_mean_over_pixels_is_taken_as_the_spec_says() -> None:
    rows: list[Row] = [
        row("a", 0, rmse=1.0, mae=1.0, far_rmse=1.0, boundary_f1=0.1, own=1.0, pixels=300),
        row("a", 1, rmse=3.0, mae=3.0, far_rmse=3.0, boundary_f1=0.3, own=3.0, pixels=100),
    ]
    found = means(rows, "pixel")
    assert found == pytest.approx({"rmse": 3**0.5, "mae": 1.5})
    for over, expected in (("mean", 1.5), ("root", 3**0.5)):
        specs = {**OURS, "own": MetricSpec("own", over_pixels=over)}
        assert means(rows, "pixel", specs)["own"] == pytest.approx(expected)


def test_means_are_over_the_frames_that_have_a_value() -> None:
    rows: list[Row] = [row("a", 0, abs_rel=0.1, rmse=1.0), row("a", 1), row("b", 0, abs_rel=0.4, rmse=3.0)]
    assert means(rows) == pytest.approx({"abs_rel": 0.25, "rmse": 2.0})
    assert means([]) == {}
    assert means([row("a", 0)]) == {}
    assert math.isnan(means([*rows, row("c", 0, abs_rel=math.nan)])["abs_rel"])
    assert means([row("a", 0, angle_mean=0.0)]) == {"angle_mean": 0.0}


def test_videos_or_pixels_can_weigh_the_same() -> None:
    rows: list[Row] = [
        row("a", 0, abs_rel=0.1, rmse=1.0, pixels=300),
        row("a", 1, abs_rel=0.2, rmse=1.0, pixels=100),
        row("b", 0, abs_rel=0.6, rmse=5.0, pixels=100),
    ]
    assert means(rows) == pytest.approx({"abs_rel": 0.3, "rmse": 7 / 3})
    assert means(rows, "video") == pytest.approx({"abs_rel": 0.375, "rmse": 3.0})
    assert means(rows, "pixel") == pytest.approx({"abs_rel": 0.11 / 0.5, "rmse": (29 / 5) ** 0.5})
    with refused(ValueError, "average", "frame, video, pixel", "'texture'"):
        means(rows, "texture")


def test_groups_keep_their_order() -> None:
    rows: list[Row] = [row("b", 1), row("a", 5), row("b", 0)]
    groups = by_video(rows)
    assert list(groups) == ["b", "a"]
    assert [r["frame"] for r in groups["b"]] == [1, 0]


def test_columns_are_those_that_other_programs_read() -> None:
    assert IDENTITY == ("model", "seed", "data", "split", "video", "segment", "texture", "frame", "protocol")
    assert METRICS[:9] == DEPTH_METRICS
    assert METRICS[9:] == ("angle_mean", "angle_median", "within_11_25", "within_22_5", "within_30")

"""summary.json and its table."""

import io
import json
from pathlib import Path

import pytest
from fake_runs import DEPTH_METRICS, METRICS
from rich.console import Console

from col3d.io.json_files import write_json
from col3d.reports.per_frame import Row
from col3d.reports.summary import print_summary, summarise

FACTS = {"model": "bts", "data": "phantom", "split": "test", "seed": 3, "protocol": "standard"}
ROWS: list[Row] = [
    {"video": "cecum_t2_a", "frame": 0, "abs_rel": 0.1, "rmse": 1.0},
    {"video": "cecum_t2_a", "frame": 1, "abs_rel": 0.2, "rmse": 2.0},
    {"video": "desc_t4_a", "frame": 0, "abs_rel": 0.6, "rmse": 9.0},
    {"video": "desc_t4_a", "frame": 1},
]


def test_frames_weigh_the_same() -> None:
    found = summarise(ROWS, FACTS)
    assert found["frames"] == 4
    assert found["metrics"] == pytest.approx({"abs_rel": 0.3, "rmse": 4.0})
    assert found["videos"]["cecum_t2_a"] == pytest.approx({"frames": 2, "abs_rel": 0.15, "rmse": 1.5})
    assert found["videos"]["desc_t4_a"] == pytest.approx({"frames": 2, "abs_rel": 0.6, "rmse": 9.0})
    assert {name: found[name] for name in FACTS} == FACTS


def test_frames_without_truth_are_counted_and_said() -> None:
    text = io.StringIO()
    assert summarise(ROWS, FACTS)["frames_without_truth"] == 1
    assert summarise(ROWS[:3], FACTS)["frames_without_truth"] == 0
    print_summary(summarise(ROWS, FACTS), Console(file=text, width=200))
    assert "1 of 4 frames have no valid depth" in text.getvalue()


def test_json_there_and_back(tmp_path: Path) -> None:
    content = summarise(ROWS, FACTS)
    write_json(tmp_path / "summary.json", content)
    assert json.loads((tmp_path / "summary.json").read_text()) == content
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


@pytest.mark.parametrize("baseline", [{}, dict.fromkeys(DEPTH_METRICS, 0.987)])
@pytest.mark.parametrize("normals", [False, True])
def test_every_video_and_value_is_shown(baseline: dict[str, float], normals: bool) -> None:
    names = METRICS if normals else ("abs_rel", "rmse")
    rows: list[Row] = [
        {**row, **{name: (i + 1) / 7 for i, name in enumerate(names)}, "abs_rel": 0.321} for row in ROWS
    ]
    text = io.StringIO()
    print_summary({**summarise(rows, FACTS), "baseline": baseline}, Console(file=text, width=200))
    shown = text.getvalue()
    for word in ("bts", "phantom", "cecum_t2_a", "desc_t4_a", "0.321"):
        assert word in shown
    assert ("0.987" in shown) == bool(baseline)

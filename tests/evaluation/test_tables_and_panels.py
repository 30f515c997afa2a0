"""What an evaluation leaves behind: the table of frames and the panels."""

from pathlib import Path
from typing import Any

import cv2
import pytest
import torch
from torch.nn.functional import normalize

from col3d.evaluation.panels import ImagePanels
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.geometry import PinholeCamera
from col3d.metrics.functional import DEPTH_METRICS, depth_metrics, normal_metrics
from col3d.registry.metric_specs import OURS
from col3d.reports.per_frame import means, read_per_frame

CAMERA = PinholeCamera.from_focal((12, 16), 10.0, 10.0, 7.5, 5.5)
FACTS = {"model": "bts", "seed": 3, "data": "phantom", "split": "test", "protocol": "standard"}


def batch_of(frames: list[int], video: str) -> dict[str, Any]:
    generator = torch.Generator().manual_seed(len(frames))
    count = len(frames)
    return {
        "image": torch.rand(count, 3, 12, 16, generator=generator),
        "depth": torch.rand(count, 1, 12, 16, generator=generator) * 50 + 1,
        "normals": normalize(torch.randn(count, 3, 12, 16, generator=generator), dim=1),
        "mask": torch.rand(count, 1, 12, 16, generator=generator) > 0.2,
        "rays": CAMERA.rays().expand(count, -1, -1, -1),
        "video": [video] * count,
        "frame": torch.tensor(frames),
    }


def scored(batch: dict[str, Any], normals: bool = True) -> dict[str, Any]:
    prediction = {"depth": batch["depth"] * 1.1 + 1}
    values = depth_metrics(prediction["depth"], batch["depth"], batch["mask"])
    if normals:
        prediction["normals"] = normalize(batch["normals"] + 0.1, dim=1)
        values |= normal_metrics(prediction["normals"], batch["normals"], batch["mask"])
    baseline = depth_metrics(torch.full_like(batch["depth"], 20.0), batch["depth"], batch["mask"])
    return {"prediction": prediction, "values": values, "baseline": baseline}


def filled(table: PerFrameTable, batches: list[dict[str, Any]], normals: bool = True) -> PerFrameTable:
    """The table with the frames of the batches, written."""
    for batch in batches:
        found = scored(batch, normals)
        table.add(batch, found["values"], found["baseline"])
    table.gather()
    table.save()
    return table


def kept(panels: ImagePanels, batches: list[dict[str, Any]], normals: bool = True) -> ImagePanels:
    """The panels that have seen the batches."""
    for batch in batches:
        found = scored(batch, normals)
        panels.keep(batch, found["prediction"], found["values"])
    return panels


def describe(video: str) -> tuple[str, str]:
    return {"b": ("cecum", "1")}.get(video, ("", ""))


def test_a_row_for_each_frame_in_order(tmp_path: Path) -> None:
    batches = [batch_of([10, 2], "b"), batch_of([3], "a")]
    table = filled(PerFrameTable(tmp_path / "per_frame.csv", FACTS, describe), batches)
    rows = read_per_frame(tmp_path / "per_frame.csv")
    assert [(row["video"], row["frame"], row["segment"]) for row in rows] == [
        ("a", "3", ""), ("b", "2", "cecum"), ("b", "10", "cecum"),
    ]  # fmt: skip
    assert all(row[name] == str(value) for row in rows for name, value in FACTS.items())
    expected = scored(batches[0])["values"]
    for name in expected:
        assert float(rows[2][name]) == expected[name][0].item()
    assert float(table.baseline[2]["abs_rel"]) == scored(batches[0])["baseline"]["abs_rel"][0].item()


def test_an_empty_frame_has_a_row_without_values_and_a_bad_one_says_nan(tmp_path: Path) -> None:
    batch = batch_of([0, 1, 2], "b")
    batch["mask"][1] = False
    outputs = scored(batch)
    outputs["values"]["abs_rel"][2] = torch.nan
    table = PerFrameTable(tmp_path / "per_frame.csv", FACTS, describe)
    table.add(batch, outputs["values"], outputs["baseline"])
    table.save()
    rows = read_per_frame(tmp_path / "per_frame.csv")
    assert [row["abs_rel"] for row in rows][1:] == ["", "nan"]
    assert all(rows[1][name] == "" for name in OURS)
    found = means(rows)
    assert found["rmse"] == pytest.approx(outputs["values"]["rmse"][[0, 2]].mean().item())
    assert found["abs_rel"] != found["abs_rel"]


def test_depth_alone_leaves_normals_empty(tmp_path: Path) -> None:
    filled(PerFrameTable(tmp_path / "per_frame.csv", FACTS, describe), [batch_of([5], "b")], normals=False)
    rows = read_per_frame(tmp_path / "per_frame.csv")
    assert [row["frame"] for row in rows] == ["5"]
    assert set(means(rows)) == set(DEPTH_METRICS)


@pytest.mark.parametrize(
    ("count", "expected"),
    [(1, {0}), (2, {0, 4}), (3, {0, 2, 4}), (9, {0, 1, 2, 3, 4}), (0, set())],
)
def test_panels_are_spread_over_the_frames(tmp_path: Path, count: int, expected: set[int]) -> None:
    panels = ImagePanels(tmp_path, "training", count)
    panels.choose(5)
    kept(panels, [batch_of([0, 1, 2], "b"), batch_of([3, 4], "b")], normals=count == 2)
    assert panels.paths == []  # the result is written first
    panels.draw()
    stems = {f"b_{number:04d}" for number in expected}
    written = {path.name for path in (tmp_path / "panels").glob("*")}
    assert written == {f"{stem}.{kind}" for stem in stems for kind in ("png", "npz")}
    assert {path.name for path in panels.paths} == {f"{stem}.png" for stem in stems}
    assert all(cv2.imread(str(path)) is not None for path in panels.paths)


def test_each_process_draws_its_own_frames(tmp_path: Path) -> None:
    """Frames 0, 2, 5 and 7 of eight; the second of two processes has the odd ones."""
    panels = ImagePanels(tmp_path, "training", 4)
    panels.choose(8, rank=1, world_size=2)
    kept(panels, [batch_of([1, 3], "b"), batch_of([5, 7], "b")])
    panels.draw()
    assert [path.name for path in panels.paths] == ["b_0005.png", "b_0007.png"]

"""The scorer: several protocols at once say what each says alone, and predictions are kept on the way."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from refusals import refused
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.errors import DivergedError
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.evaluation.predict_frames import predict_frames
from col3d.evaluation.scorer import Scoring, score
from col3d.geometry import PinholeCamera, normals_from_depth
from col3d.io.predictions import PredictionWriter, StoredPredictions
from col3d.metrics import Protocol

SIZE = (12, 16)
CAMERA = PinholeCamera.from_focal(SIZE, 10.0, 10.0, 7.5, 5.5)
PROTOCOLS = (Protocol("standard"), Protocol("median_scaled", scaling="median"))


class Constant(nn.Module):
    """Some depth, more of it where the image is bright."""

    tasks = ("depth", "normals")

    def forward(self, image: Tensor, rays: Tensor) -> Prediction:
        depth = 20 + 30 * image.mean(dim=1, keepdim=True)
        return {"depth": depth, "normals": normals_from_depth(depth, rays, depth > 0)}


def batches() -> Iterator[Batch]:
    generator = torch.Generator().manual_seed(0)
    for video, frames in (("b", [0, 1, 2]), ("a", [7])):
        depth = 10 + 60 * torch.rand(len(frames), 1, *SIZE, generator=generator)
        rays = CAMERA.rays().expand(len(frames), -1, -1, -1)
        yield {
            "image": torch.rand(len(frames), 3, *SIZE, generator=generator),
            "depth": depth,
            "normals": normals_from_depth(depth, rays, depth > 0),
            "mask": torch.rand(len(frames), 1, *SIZE, generator=generator) > 0.1,
            "rays": rays,
            "video": [video] * len(frames),
            "frame": torch.tensor(frames),
        }


def one_by_one() -> Iterator[Batch]:
    for batch in batches():
        for index in range(len(batch["video"])):
            yield {key: values[index : index + 1] for key, values in batch.items()}  # type: ignore[index,misc]


def rows(folder: Path, *protocols: Protocol, **more: Any) -> list[list[dict[str, Any]]]:
    tables = [PerFrameTable(folder / "per_frame.csv", {}, lambda video: ("", "")) for _ in protocols]
    scorings = [Scoring(protocol, table, **more) for protocol, table in zip(protocols, tables, strict=True)]
    score(predict_frames(Constant(), batches()), scorings, torch.tensor(40.0))
    return [table.rows for table in tables]


def test_several_protocols_say_what_each_says_alone(tmp_path: Path) -> None:
    together = rows(tmp_path, *PROTOCOLS)
    assert together == [rows(tmp_path, protocol)[0] for protocol in PROTOCOLS]
    assert together[0] != together[1]
    assert [(row["video"], row["frame"]) for row in together[0]] == [("a", 7), ("b", 0), ("b", 1), ("b", 2)]


def test_a_truth_of_its_own_is_met_frame_by_frame(tmp_path: Path) -> None:
    found = rows(tmp_path, PROTOCOLS[0], truth=one_by_one())[0]
    for row, expected in zip(found, rows(tmp_path, PROTOCOLS[0])[0], strict=True):
        assert row.keys() == expected.keys()
        for name, value in row.items():
            assert value == (expected[name] if isinstance(value, str) else pytest.approx(expected[name])), (
                name
            )


def test_another_order_of_the_truth_is_no_score(tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        rows(tmp_path, PROTOCOLS[0], truth=iter([*one_by_one()][::-1]))


def test_predictions_are_written_in_the_same_pass(tmp_path: Path) -> None:
    writer = PredictionWriter(tmp_path / "kept", {"max_depth": 100.0, "split": "test"})
    score(predict_frames(Constant(), batches()), [], writers={None: writer})
    stored = StoredPredictions(tmp_path / "kept")
    assert stored.frames() == [("a", 7), ("b", 0), ("b", 1), ("b", 2)]
    for batch in batches():
        expected = Constant()(batch["image"], batch["rays"])["depth"]
        for index, (video, frame) in enumerate(zip(batch["video"], batch["frame"].tolist(), strict=True)):
            depth = torch.from_numpy(stored.read(video, frame)[0])
            torch.testing.assert_close(depth, expected[index, 0], atol=1e-3, rtol=0)


def test_what_is_not_finite_is_named_and_leaves_no_file(tmp_path: Path) -> None:
    class Broken(Constant):
        def forward(self, image: Tensor, rays: Tensor) -> Prediction:
            found = super().forward(image, rays)
            found["depth"][-1, 0, 3, 3] = torch.nan
            return found

    writer = PredictionWriter(tmp_path / "kept", {"max_depth": 100.0, "split": "test"})
    with refused(DivergedError, None, "depth of b:2 "):
        score(predict_frames(Broken(), batches()), [], writers={None: writer})
    assert [path.name for path in (tmp_path / "kept").rglob("*") if path.suffix in (".npz", ".partial")] == []

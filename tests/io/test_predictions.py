"""Predictions on disk: exact enough, whole or not there at all."""

from pathlib import Path

import numpy as np
from refusals import refused

from col3d.io.predictions import PredictionWriter, StoredPredictions, read_facts

FACTS = {"max_depth": 100.0, "split": "test"}


def frame(seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    normals = random.standard_normal((6, 8, 3)).astype(np.float32)
    depth = random.uniform(0, 100, (6, 8)).astype(np.float32)
    return depth, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def test_there_and_back(tmp_path: Path) -> None:
    writer = PredictionWriter(tmp_path, FACTS)
    for video, number in [("a", 3), ("a", 12), ("b", 0)]:
        writer.add(video, number, *frame(number))
    writer.finish()
    stored = StoredPredictions(tmp_path)
    for video, number in [("b", 0), ("a", 12), ("a", 3)]:
        (depth, normals), (expected, directions) = stored.read(video, number), frame(number)
        assert normals is not None
        assert np.abs(depth - expected).max() < 1e-3
        sine = np.linalg.norm(np.cross(normals.astype(float), directions), axis=-1)
        assert np.degrees(np.arcsin(sine)).max() < 0.003
    assert stored.facts == FACTS
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["a.npz", "b.npz", "index.json"]


def test_depth_alone(tmp_path: Path) -> None:
    writer = PredictionWriter(tmp_path, FACTS)
    writer.add("a", 0, frame(0)[0], None)
    writer.finish()
    assert StoredPredictions(tmp_path).read("a", 0)[1] is None


def test_what_was_cut_off_is_not_there(tmp_path: Path) -> None:
    writer = PredictionWriter(tmp_path, FACTS)
    writer.add("a", 0, *frame(0))
    assert read_facts(tmp_path) is None
    with refused(ValueError, None, tmp_path, "index.json"):
        StoredPredictions(tmp_path)
    again = PredictionWriter(tmp_path, FACTS)
    again.add("a", 0, *frame(0))
    again.finish()
    assert read_facts(tmp_path) == FACTS


def test_truth_keeps_images_and_occlusions(tmp_path: Path) -> None:
    writer, (depth, normals) = PredictionWriter(tmp_path, FACTS), frame(0)
    image, hidden = np.random.default_rng(1).uniform(size=(6, 8, 3)), depth > 50
    writer.add("a", 0, depth, normals, image, hidden)
    writer.add("a", 1, depth, normals, image)
    writer.finish()
    stored = StoredPredictions(tmp_path)
    assert np.abs(stored.read_image("a", 0) - image).max() < 1 / 500
    assert np.array_equal(stored.read_occlusion("a", 0), hidden)
    assert stored.read_occlusion("a", 1) is None
    assert stored.frames() == [("a", 0), ("a", 1)]

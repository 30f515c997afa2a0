"""Averaging with the mirrored frame: a twin of the published ramp in numpy, and laws."""

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.evaluation.mirror import mirror_average
from col3d.evaluation.predict_frames import predict_frames
from col3d.geometry import OmnidirectionalCamera, unit

CAMERA = OmnidirectionalCamera.c3vd().resized((12, 40))
GENERATOR = torch.Generator().manual_seed(0)
KERNEL = torch.randn(4, 3, 3, 3, generator=GENERATOR)
BATCH: Batch = {
    "image": torch.rand(2, 3, 12, 40, generator=GENERATOR),
    "depth": torch.full((2, 1, 12, 40), 50.0),
    "mask": torch.ones(2, 1, 12, 40, dtype=torch.bool),
    "rays": CAMERA.rays().expand(2, -1, -1, -1),
    "video": ["a", "b"],
    "frame": torch.tensor([0, 1]),
}
MIRROR = np.array([-1.0, 1.0, 1.0])[:, None, None]
either = pytest.mark.parametrize("ramp", [False, True])


class Lopsided(nn.Module):
    """Tells left from right."""

    tasks = ("depth", "normals")

    def forward(self, image: Tensor, rays: Tensor) -> Prediction:
        maps = nn.functional.conv2d(image, KERNEL, padding=1)
        return {"depth": 50 + 5 * maps[:, :1], "normals": unit(0.3 * maps[:, 1:] - rays)}


def lopsided(batch: Batch) -> Prediction:
    found: Prediction = Lopsided()(batch["image"], batch["rays"])
    return found


def even_handed(batch: Batch) -> Prediction:
    across = torch.tensor([0.0, 0.5, 0.5])[:, None, None] * batch["image"]
    return {"depth": 50 * batch["image"].mean(dim=1, keepdim=True), "normals": unit(across - batch["rays"])}


def wide(values: Tensor) -> np.ndarray:
    return values.double().numpy()


def both_ways() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The direct prediction, and that of the mirrored frame mirrored back."""
    flipped: Any = {**BATCH, "image": BATCH["image"].flip(-1), "rays": CAMERA.flipped().rays()[None]}
    direct, other = lopsided(BATCH), lopsided(flipped)
    back = {"depth": wide(other["depth"])[..., ::-1], "normals": wide(other["normals"])[..., ::-1] * MIRROR}
    return {"depth": wide(direct["depth"]), "normals": wide(direct["normals"])}, back


WAYS = {False: "mean", True: "ramp"}


def blended(direct: np.ndarray, mirrored: np.ndarray, ramp: bool) -> np.ndarray:
    """The published post-processing."""
    mean: np.ndarray = (direct + mirrored) / 2
    if not ramp:
        return mean
    left = 1 - np.clip(20 * (np.linspace(0, 1, direct.shape[-1]) - 0.05), 0, 1)
    right = left[::-1]
    blend: np.ndarray = right * direct + left * mirrored + (1 - left - right) * mean
    return blend


@either
def test_the_average_equals_its_twin(ramp: bool) -> None:
    direct, mirrored = both_ways()
    found = mirror_average(lopsided, BATCH, WAYS[ramp])
    np.testing.assert_allclose(
        wide(found["depth"]), blended(direct["depth"], mirrored["depth"], ramp), rtol=1e-6
    )
    normals = blended(direct["normals"], mirrored["normals"], ramp)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(wide(found["normals"]), normals, atol=1e-5)


def test_a_ramp_goes_from_the_mirrored_prediction_over_the_mean_to_the_direct_one() -> None:
    direct, mirrored = (maps["depth"] for maps in both_ways())
    found = wide(mirror_average(lopsided, BATCH, "ramp")["depth"])
    np.testing.assert_allclose(found[..., 0], mirrored[..., 0], rtol=1e-6)
    np.testing.assert_allclose(found[..., -1], direct[..., -1], rtol=1e-6)
    np.testing.assert_allclose(found[..., 4:-4], ((direct + mirrored) / 2)[..., 4:-4], rtol=1e-6)
    assert not np.isclose(direct, mirrored).any(axis=(0, 1, 2)).all()


@either
def test_who_commutes_with_mirroring_keeps_its_own_prediction(ramp: bool) -> None:
    found, expected = mirror_average(even_handed, BATCH, WAYS[ramp]), even_handed(BATCH)
    for key in ("depth", "normals"):
        torch.testing.assert_close(found[key], expected[key], atol=1e-5, rtol=1e-5)


@either
def test_normals_have_unit_length(ramp: bool) -> None:
    lengths = mirror_average(lopsided, BATCH, WAYS[ramp])["normals"].norm(dim=1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_the_network_sees_the_mirrored_image_with_the_rays_of_the_mirrored_camera() -> None:
    seen: list[Batch] = []

    def watched(batch: Batch) -> Prediction:
        seen.append(batch)
        return {"depth": batch["depth"]}

    assert set(mirror_average(watched, BATCH)) == {"depth"}
    assert len(seen) == 2
    assert torch.equal(seen[0]["image"], BATCH["image"])
    assert torch.equal(seen[0]["rays"], BATCH["rays"])
    assert torch.equal(seen[1]["image"], BATCH["image"].flip(-1))
    expected = CAMERA.flipped().rays().expand(2, -1, -1, -1)
    torch.testing.assert_close(seen[1]["rays"], expected, atol=1e-6, rtol=0)


def test_frames_are_predicted_in_each_way_that_is_asked_for() -> None:
    expected = {None: lopsided(BATCH), "mean": mirror_average(lopsided, BATCH)}
    expected["ramp"] = mirror_average(lopsided, BATCH, "ramp")
    (batch, found), *others = predict_frames(Lopsided(), [BATCH], [None, "mean", "ramp", "mean"])
    assert batch is BATCH
    assert others == []
    assert found.keys() == expected.keys()
    for mirror, prediction in expected.items():
        for key in ("depth", "normals"):
            assert torch.equal(found[mirror][key], prediction[key])

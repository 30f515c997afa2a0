"""Means over frames: any batches, any processes; empty frames and NaN."""

from pathlib import Path
from typing import Any

import pytest
import torch
from refusals import refused
from torch import Tensor, distributed, multiprocessing

from col3d.metrics import DepthMetrics, FrameMean, NormalMetrics
from col3d.metrics.functional import DEPTH_METRICS, NORMAL_METRICS, depth_metrics, normal_metrics
from col3d.registry.metric_specs import OURS

FRAMES = 7


def maps(channels: int) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    target = torch.rand(FRAMES, channels, 9, 11, generator=generator) * 50 + 1
    preds = target + torch.randn(FRAMES, channels, 9, 11, generator=generator).clamp(-0.9)
    mask = torch.rand(FRAMES, 1, 9, 11, generator=generator) > 0.3
    if channels == 3:
        preds, target = preds + 20 * torch.randn(preds.shape, generator=generator), target - 25
    mask[0, :, 2:] = False  # frames weigh the same, however few their pixels
    return preds, target, mask


CASES: list[Any] = [(DepthMetrics, depth_metrics, 1), (NormalMetrics, normal_metrics, 3)]


@pytest.mark.parametrize(("metric_type", "function", "channels"), CASES)
@pytest.mark.parametrize("sizes", [[7], [1] * 7, [3, 3, 1], [5, 2]])
def test_batches_are_of_no_matter(metric_type: Any, function: Any, channels: int, sizes: list[int]) -> None:
    metric, parts = metric_type(), (values.split(sizes) for values in maps(channels))
    for preds, target, mask in zip(*parts, strict=True):
        metric.update(preds, target, mask)
    expected = {name: values.mean().item() for name, values in function(*maps(channels)).items()}
    assert {name: value.item() for name, value in metric.compute().items()} == pytest.approx(
        expected, rel=1e-7
    )
    assert metric.frames == FRAMES
    assert metric.empty_frames == 0


@pytest.mark.parametrize(("metric_type", "function", "channels"), CASES)
def test_empty_frames_are_left_out_and_counted(metric_type: Any, function: Any, channels: int) -> None:
    preds, target, mask = maps(channels)
    mask[[2, 5]] = False
    metric = metric_type()
    metric.update(preds, target, mask)
    kept = mask.flatten(1).any(dim=1)
    expected = {n: v.mean().item() for n, v in function(preds[kept], target[kept], mask[kept]).items()}
    assert {name: value.item() for name, value in metric.compute().items()} == pytest.approx(expected)
    assert (metric.frames, metric.empty_frames) == (FRAMES - 2, 2)


@pytest.mark.parametrize(
    ("metric_type", "name", "channels"), [(DepthMetrics, "abs_rel", 1), (NormalMetrics, "angle_mean", 3)]
)
def test_a_prediction_that_is_not_a_number_stays_one(metric_type: Any, name: str, channels: int) -> None:
    preds, target, mask = maps(channels)
    preds[3, :, 4, 4], mask[3, :, 4, 4] = torch.nan, True
    metric = metric_type()
    metric.update(preds, target, mask)
    assert metric.compute()[name].isnan()
    metric.reset()
    metric.update(preds[:3], target[:3], mask[:3])
    assert metric.compute()[name].isfinite()


def test_before_the_first_frame() -> None:
    metric = DepthMetrics()
    with pytest.warns(UserWarning, match="before the ``update``"):
        assert all(value.isnan() for value in metric.compute().values())
    preds, target, mask = maps(1)
    metric.update(preds, target, torch.zeros_like(mask))
    assert all(value.isnan() for value in metric.compute().values())
    assert metric.empty_frames == FRAMES


def test_options_reach_the_function() -> None:
    preds, target, mask = maps(1)
    metric = DepthMetrics({"max_depth": 20.0})
    metric.update(preds, target, mask)
    expected = depth_metrics(preds, target, mask, max_depth=20.0)["rmse"].mean()
    torch.testing.assert_close(metric.compute()["rmse"], expected)
    assert expected > 2 * depth_metrics(preds, target, mask)["rmse"].mean()


def test_names_are_those_of_the_tables() -> None:
    assert (*DepthMetrics().names, *NormalMetrics().names) == (*DEPTH_METRICS, *NORMAL_METRICS)
    assert tuple(OURS)[:14] == (*DEPTH_METRICS, *NORMAL_METRICS)


def test_has_no_metric_of_its_own() -> None:
    with refused(TypeError, None, "DepthMetrics", "NormalMetrics"):
        FrameMean(("a",)).update(*maps(1))


def one_process(rank: int, folder: str) -> None:
    """Rank 0 has five frames in two batches, rank 1 two in one, the last of them empty."""
    distributed.init_process_group("gloo", init_method=f"file://{folder}/store", rank=rank, world_size=2)
    metric, (preds, target, mask) = DepthMetrics(), maps(1)
    mask[-1] = False
    for part in [slice(0, 4), slice(4, 5)] if rank == 0 else [slice(5, 7)]:
        metric.update(preds[part], target[part], mask[part])
    torch.save(metric.compute(), f"{folder}/{rank}.pt")
    distributed.barrier()
    distributed.destroy_process_group()


@pytest.mark.end_to_end
def test_two_processes_are_one(tmp_path: Path) -> None:
    multiprocessing.spawn(one_process, (str(tmp_path),), nprocs=2)  # type: ignore[attr-defined, no-untyped-call]
    preds, target, mask = maps(1)
    values = depth_metrics(preds[:-1], target[:-1], mask[:-1])
    for rank in range(2):
        found = torch.load(tmp_path / f"{rank}.pt")
        for name in DEPTH_METRICS:
            torch.testing.assert_close(found[name], values[name].mean(), rtol=1e-12, atol=0)

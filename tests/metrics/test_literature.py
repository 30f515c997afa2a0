"""Protocols of other papers against figures that their own programs gave, and laws of alignments."""

from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from parity import needs_parity
from tiny_run import composed
from torch import Tensor

from col3d.evaluation.options import EvaluateOptions
from col3d.evaluation.scorer import build_protocol
from col3d.metrics import Protocol
from col3d.metrics.alignment import DOMAINS, FITS, alignment
from col3d.registry.refusals import check_options

THEIRS = {"d1": "delta1", "d2": "delta2", "d3": "delta3", "silog": "silog_half"}
"""Names of EndoStreamDepth's program -> names here, where they differ."""


def protocol_of(name: str) -> Protocol:
    given = composed("evaluate", f"protocol={name}", "checkpoint=x", "data=phantom", "output_dir=x")
    options = check_options(EvaluateOptions, given)
    return build_protocol(name, options.protocol[name], options.metrics)


def batch_of(truth: Tensor, mask: Tensor | None = None) -> Any:
    videos = ["video_a"] * len(truth)
    return {"depth": truth, "mask": truth > 0 if mask is None else mask, "video": videos}


@needs_parity
def test_figures_of_endostreamdepth(literature: tuple[dict[str, Any], Tensor, Tensor]) -> None:
    figures, pred, truth = literature
    found = protocol_of("endostreamdepth").score({"depth": pred}, batch_of(truth))
    for i, frame in enumerate(figures["endostreamdepth"]["per_frame"]):
        for name in ("d1", "d2", "d3", "abs_rel", "sq_rel", "rmse", "rmse_log", "log10", "silog", "mae"):
            assert found[THEIRS.get(name, name)][i].item() == pytest.approx(frame[name], rel=1e-6), name
    assert set(found) == {*(protocol_of("endostreamdepth").names or ()), "pixels"}


@needs_parity
def test_figures_of_ppsnet(literature: tuple[dict[str, Any], Tensor, Tensor]) -> None:
    figures, pred, truth = literature
    filled = torch.where(truth > 0, truth, 50.0)
    found = protocol_of("ppsnet").score({"depth": pred.double()}, batch_of(filled.double()))
    for i, frame in enumerate(figures["ppsnet"]["per_frame"]):
        assert found["abs_rel"][i].item() == pytest.approx(frame["abs_rel"], rel=1e-6)
        assert found["sq_rel"][i].item() == pytest.approx(1000 * frame["sq_rel"], rel=1e-6)
        assert found["rmse"][i].item() == pytest.approx(1000 * frame["rmse"], rel=1e-6)
        assert found["rmse_log"][i].item() == pytest.approx(frame["rmse_log"], rel=1e-6)
        assert found["within_10_percent"][i].item() == pytest.approx(frame["a1"], rel=1e-6)


@needs_parity
@pytest.mark.parametrize(("video", "frames"), [("video_a", slice(0, 3)), ("video_b", slice(3, 7))])
def test_figures_of_simcol3d(
    literature: tuple[dict[str, Any], Tensor, Tensor], video: str, frames: slice
) -> None:
    """Its predictions are stored as float16 of depth / 200 mm, and its means are of that precision, too."""
    figures, pred, truth = literature
    stored = 200 * (pred[frames].clamp(0, 200) / 200).half().double()
    batch = batch_of(torch.where(truth[frames] > 0, truth[frames], 50.0).double())
    protocol, theirs = protocol_of("simcol3d"), figures["simcol3d"][video]
    ours = protocol.of_video([({"depth": stored}, batch)])
    assert ours(torch.ones(1).double()).item() == pytest.approx(theirs["scale"], rel=1e-3)
    found = protocol.score({"depth": stored}, batch, aligned=lambda values: theirs["scale"] * values)
    for name, figure in (("l1_cm", "l1_cm"), ("median_rel", "median_rel_percent"), ("rmse_cm", "rmse_cm")):
        assert found[name].mean().item() == pytest.approx(theirs[figure], rel=1e-3), name


@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("fit", [name for name in FITS if name != "none"])
@given(factor=st.floats(0.2, 5.0), seed=st.integers(0, 50))
def test_a_fit_undoes_a_factor(fit: str, domain: str, factor: float, seed: int) -> None:
    truth = torch.rand(40, generator=torch.Generator().manual_seed(seed)).double() * 90 + 5
    aligned = alignment(fit, domain, [(factor * truth, truth)])(factor * truth)
    # the solver of one of them stops where a median is flat, and the deepest truth limits inverse depth
    torch.testing.assert_close(aligned, truth, rtol=2e-2 if fit == "median_residual" else 1e-9, atol=0)


@given(slope=st.floats(0.2, 5.0), offset=st.floats(-0.001, 0.02), seed=st.integers(0, 50))
def test_an_offset_of_inverse_depth_is_undone_there_alone(slope: float, offset: float, seed: int) -> None:
    truth = torch.rand(40, generator=torch.Generator().manual_seed(seed)).double() * 40 + 5
    guess = (slope / truth + offset).reciprocal()
    inverse = alignment("scale_and_shift", "inverse_depth", [(guess, truth)])(guess)
    torch.testing.assert_close(inverse, truth, rtol=1e-6, atol=0)


@pytest.mark.parametrize(
    ("fit", "loss"),
    [
        ("least_squares", lambda guess, truth: (guess - truth).square().sum()),
        ("least_absolute", lambda guess, truth: ((guess - truth).abs() / truth).sum()),
    ],
)
@given(seed=st.integers(0, 100))
def test_no_other_factor_is_better(fit: str, loss: Any, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    guess, truth = (torch.rand(2, 33, generator=generator) * 90 + 5).double()
    best = loss(alignment(fit, "depth", [(guess, truth)])(guess), truth)
    for factor in torch.linspace(0.2, 4.0, 300).tolist():
        assert best <= loss(factor * guess, truth) + 1e-9


def test_a_video_has_one_factor_and_a_frame_its_own() -> None:
    truth = torch.full((2, 1, 4, 5), 20.0)
    guess = truth * torch.tensor([2.0, 0.5]).view(2, 1, 1, 1)
    batch: Any = batch_of(truth)
    one, each = (Protocol("x", "means", scaling_over=over) for over in ("video", "frame"))
    assert one.aligns_videos
    assert not each.aligns_videos
    assert each.score({"depth": guess}, batch)["abs_rel"].tolist() == pytest.approx([0, 0], abs=1e-6)
    aligned = one.of_video([({"depth": guess}, batch)])
    found = one.score({"depth": guess}, batch, aligned=aligned)["abs_rel"]
    factor = (40 * 20 + 10 * 20) / (40**2 + 10**2)
    assert found.tolist() == pytest.approx([abs(factor * 2 - 1), abs(factor / 2 - 1)], rel=1e-6)


def test_of_points_on_true_rays_relative_errors_are_those_of_depth() -> None:
    generator = torch.Generator().manual_seed(0)
    rays = torch.randn(3, 6, 7, generator=generator).double()
    rays[2] = rays[2].abs() + 1
    guess, truth = (torch.rand(2, 6, 7, generator=generator) * 50 + 5).double()
    points, true_points = (depth * rays / rays[2] for depth in (guess, truth))
    relative = (points - true_points).norm(dim=0) / true_points.norm(dim=0)
    torch.testing.assert_close(relative, (guess - truth).abs() / truth)

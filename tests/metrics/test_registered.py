"""Metrics by name: what a registration takes, what is measured, and what is refused."""

from collections.abc import Callable
from typing import Annotated, Any

import pytest
import torch
from pydantic import Field
from refusals import refused
from torch import Tensor

from col3d.errors import OptionError, UserError
from col3d.metrics import Protocol, TaskMetrics, registered_specs
from col3d.metrics.measure import measure, try_metrics
from col3d.metrics.options import metric_options
from col3d.registry import (
    MODELS,
    available,
    describe,
    register_metric,
    register_metrics,
    register_model,
)
from col3d.registry.metric_specs import LITERATURE, OURS, MetricSpec, specs_from
from col3d.reports.paper_tables import methods

MAPS = (
    torch.full((3, 1, 4, 5), 12.0),
    torch.full((3, 1, 4, 5), 10.0),
    torch.ones(3, 1, 4, 5, dtype=torch.bool),
)


def bias(preds: Tensor, target: Tensor, mask: Tensor, power: Annotated[float, Field(gt=0)] = 1.0) -> Tensor:
    """Mean of prediction less truth."""
    gap = torch.where(mask, preds - target, 0.0).sum(dim=(1, 2, 3)) / mask.sum(dim=(1, 2, 3))
    return gap.pow(power)


def test_every_metric_of_ours_is_registered_in_the_order_of_the_table() -> None:
    assert registered_specs() == OURS
    assert list(registered_specs()) == list(OURS)
    assert set(available("metric")) == {*OURS, *(spec.name for spec in LITERATURE)}
    assert list(registered_specs("depth", validation=True)) == [*tuple(OURS)[:9], "delta_1_1", "mae"]
    assert "  metrics.boundary_f1.erosion: int, ge=0, le=100; 0 unless given" in describe(
        "metric", "boundary_f1"
    )


def test_a_metric_is_measured_beside_ours_and_comes_after_them() -> None:
    register_metric("bias", bias, task="depth", unit="mm", heading="Bias")
    found = measure("depth", *MAPS)
    assert list(found)[-1] == "bias"
    assert found["bias"].tolist() == [2.0, 2.0, 2.0]
    assert measure("depth", *MAPS, options={"bias": {"power": 3.0}})["bias"].tolist() == [8.0, 8.0, 8.0]
    batch: Any = {"depth": MAPS[1], "mask": MAPS[2]}
    scored = Protocol(metrics={"bias": {"power": 2.0}}).score({"depth": MAPS[0]}, batch)
    assert scored["bias"].tolist() == [4.0, 4.0, 4.0]
    assert "bias" not in measure("normals", *(x.expand(3, 3, 4, 5) for x in MAPS[:2]), MAPS[2])


def test_ours_are_not_changed_by_others() -> None:
    before = measure("depth", *MAPS)
    register_metric("bias", bias)
    after = measure("depth", *MAPS)
    assert all(torch.equal(after[name], value) or value.isnan().all() for name, value in before.items())


def test_one_function_of_several_metrics_is_called_once() -> None:
    calls = []

    def both(preds: Tensor, target: Tensor, mask: Tensor) -> dict[str, Tensor]:
        calls.append(1)
        return {"most": preds.amax(dim=(1, 2, 3)), "least": preds.amin(dim=(1, 2, 3))}

    register_metrics((MetricSpec("most"), MetricSpec("least")), both)
    found = measure("depth", *MAPS)
    assert (found["most"].tolist(), found["least"].tolist(), len(calls)) == ([12.0] * 3, [12.0] * 3, 1)


def test_predictions_are_bounded_unless_the_function_does_so_itself() -> None:
    def seen(preds: Tensor, target: Tensor, mask: Tensor) -> Tensor:
        return preds.flatten(1).sum(dim=1)

    def own(preds: Tensor, target: Tensor, mask: Tensor, min_depth: float, max_depth: float) -> Tensor:
        return preds[:, 0, 0, 0] + max_depth

    register_metric("seen", seen)
    register_metric("own", own)
    preds = torch.tensor([-5.0, 40.0]).view(1, 1, 1, 2)
    maps = preds, torch.ones_like(preds), torch.ones_like(preds, dtype=torch.bool)
    found = measure("depth", *maps, max_depth=30.0)
    assert found["seen"].item() == pytest.approx(30.001)
    assert found["own"].item() == 25.0


@pytest.mark.parametrize(
    ("answer", "came"),
    [
        (lambda preds: preds.mean(), "shape ()"),
        (lambda preds: preds.mean(dim=1), "shape (3, 4, 5)"),
        (lambda preds: preds.flatten(1).mean(dim=1, keepdim=True), "shape (3, 1)"),
        (lambda preds: 0.5, "float"),
        (lambda preds: None, "NoneType"),
        (lambda preds: {"other": preds.flatten(1).mean(dim=1)}, "NoneType"),
    ],
)
def test_what_is_no_value_a_frame_is_refused(answer: Callable[[Tensor], Any], came: str) -> None:
    def wrong(preds: Tensor, target: Tensor, mask: Tensor) -> Any:
        return answer(preds)

    register_metric("wrong", wrong)
    with refused(UserError, "metric wrong", "wrong has to return", f"got {came}"):
        measure("depth", *MAPS)
    with refused(UserError, "metric wrong", "(2,)", "2 frames"):
        try_metrics(("depth",), (4, 5))
    try_metrics(("normals",), (4, 5))


def test_an_error_of_the_function_is_left_as_it_is() -> None:
    def broken(preds: Tensor, target: Tensor, mask: Tensor) -> Tensor:
        raise KeyError("mine")

    register_metric("broken", broken, task="normals")
    with refused(KeyError, None, "mine"):
        try_metrics(("depth", "normals"), (4, 5))


@pytest.mark.parametrize(
    ("said", "named"),
    [
        ({"name": "pixels"}, ("pixels ", "column")),
        ({"name": "video"}, ("video ", "column")),
        ({"name": "loss"}, ("loss ", "column")),
        ({"name": "loss_depth"}, ("loss_depth ", "column")),
        ({"name": "a b"}, ("'a b'",)),
        ({"name": "abs_rel"}, ("abs_rel ", "col3d")),
        ({"task": "dpeth"}, ("mine: task: ", "'dpeth'", "'depth'")),
        ({"better": "up"}, ("mine: better: ", "'up'")),
        ({"over_pixels": "sum"}, ("mine: over_pixels: ", "'sum'")),
        ({"heading": "a\nb"}, ("mine: heading: ", "one line")),
        ({"decimals": -1}, ("mine: decimals: ", "0 to 12", -1)),
    ],
)
def test_registrations_that_files_could_not_hold(said: dict[str, Any], named: tuple[object, ...]) -> None:
    given = {"name": "mine", **said}
    with refused(ValueError, "register_metric", *named):
        register_metric(given.pop("name"), bias, **given)


@pytest.mark.parametrize(
    ("said", "named"),
    [
        ({"label": "a\nb"}, ("mine: label: ", "one line")),
        ({"colour": "red"}, ("mine: colour: ", "#RRGGBB", "'red'")),
        ({"colour": "#12345"}, ("mine: colour: ", "#RRGGBB", "'#12345'")),
    ],
)
def test_labels_and_colours_that_reports_could_not_show(said: dict[str, str], named: tuple[str, ...]) -> None:
    with refused(ValueError, "register_model", *named):
        register_model("mine", torch.nn.Identity, **said)


def test_networks_of_the_paper_are_called_as_the_paper_calls_them() -> None:
    """Whether a run recorded its label or is of before; each has a colour of its own."""
    networks = {name: MODELS[name].facts for name in methods()}
    assert {name: facts["label"] for name, facts in networks.items()} == methods()
    assert len({facts["colour"] for facts in networks.values()}) == len(networks) == 7


def test_options_are_held_against_the_signature() -> None:
    register_metric("bias", bias)
    assert metric_options({"bias": {"power": "2"}, "boundary_f1": {}}) == {
        "bias": {"power": 2.0},
        "boundary_f1": {},
    }


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        ({"boundary_fl": {}}, "metrics", ("'boundary_fl'", "'boundary_f1'")),
        (
            {"boundary_f1": {"min_treshold": 1.1}},
            "metrics.boundary_f1.min_treshold",
            ("'metrics.boundary_f1.min_threshold'",),
        ),
        ({"boundary_f1": {"erosion": -1}}, "metrics.boundary_f1.erosion", ("or equal to 0", -1)),
        ({"boundary_f1": {"min_threshold": "x"}}, "metrics.boundary_f1.min_threshold", ("number", "'x'")),
        ({"boundary_f1": 3}, "metrics.boundary_f1", ("options", 3)),
        ({"abs_rel": {"max_depth": 3}}, "metrics.abs_rel.max_depth", ("no such option",)),
        (["boundary_f1"], "metrics", ("names of metrics", "['boundary_f1']")),
    ],
)
def test_options_that_break_a_rule_are_one_line(given: Any, about: str, named: tuple[object, ...]) -> None:
    with refused(OptionError, about, *named) as error:
        metric_options(given)
    assert "\n" not in str(error.value)


def test_functions_of_several_metrics_take_options_once() -> None:
    def both(preds: Tensor, target: Tensor, mask: Tensor, share: float = 0.5) -> dict[str, Tensor]:
        return {name: preds.flatten(1).quantile(share, dim=1) for name in ("one", "other")}

    register_metrics((MetricSpec("one"), MetricSpec("other")), both)
    assert metric_options({"other": {"share": 0.1}}) == {"other": {"share": 0.1}}
    with refused(OptionError, "metrics.other", "one"):
        metric_options({"one": {"share": 0.1}, "other": {"share": 0.2}})


def test_validation_leaves_out_frames_that_have_no_such_value() -> None:
    def of_first(preds: Tensor, target: Tensor, mask: Tensor) -> Tensor:
        return torch.tensor([4.0, torch.nan, 8.0])

    register_metric("first", of_first)
    register_metric("late", bias, in_validation=False)
    preds = MAPS[0].clone()
    preds[1] = torch.nan
    metric = TaskMetrics("depth")
    metric.update(preds, MAPS[1], MAPS[2])
    means = metric.compute()
    assert means["first"].item() == 6.0
    assert means["abs_rel"].isnan()
    assert "late" not in means
    metric.reset()
    metric.update(MAPS[0], MAPS[1], MAPS[2])
    assert metric.compute()["abs_rel"].item() == pytest.approx(0.2)


def test_specs_come_back_from_what_a_run_records() -> None:
    recorded = {name: spec.plain() for name, spec in OURS.items()}
    assert specs_from(recorded) == OURS
    later = {"new": {"better": "lower", "invented_later": 3}}
    assert specs_from(later) == {"new": MetricSpec("new", better="lower")}


def test_headings_fall_back_to_the_name() -> None:
    plain, full = MetricSpec("sharp"), MetricSpec("sharp", unit="mm", heading="Sharpness")
    assert (plain.title, plain.screen_title) == ("sharp", "sharp")
    assert (full.title, full.screen_title) == ("Sharpness", "Sharpness mm")
    assert MetricSpec("share", unit="%", scale=100.0).screen_title == "share"

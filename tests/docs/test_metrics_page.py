"""The table of metrics in `docs/protocols.md` is that of the program."""

from typing import Any

import torch
from pages import PROJECT, blocks

from col3d.metrics.measure import measure
from col3d.registry import available
from col3d.registry.metric_specs import OURS, MetricSpec

PAGE = PROJECT / "docs" / "protocols.md"
OVER_PIXELS = {"mean": "mean", "root": "root of the mean square", None: "left out"}


def line(spec: MetricSpec) -> str:
    unit = "percent in tables, a fraction in files" if spec.scale == 100 else spec.unit
    cells = (
        *(f"`{spec.name}`", spec.title, spec.task, unit, str(spec.better)),
        *(OVER_PIXELS[spec.over_pixels], "yes" if spec.in_validation else "no"),
    )
    return f"| {' | '.join(cells)} |"


def test_every_metric_stands_in_the_table_in_order() -> None:
    page = PAGE.read_text(encoding="utf-8").splitlines()
    start = page.index("| metric | heading | of | unit | better | `average=pixel` | as `val/` |") + 2
    assert page[start : start + len(OURS)] == [line(spec) for spec in OURS.values()]
    assert not page[start + len(OURS)].startswith("|")


def test_the_metric_of_the_page_is_measured() -> None:
    available("metric")
    block = next(block for block in blocks(PAGE, "python") if "register_metric" in block)
    names: dict[str, Any] = {"__name__": "mylab"}
    exec(block, names)
    target = torch.full((2, 1, 3, 4), 40.0)
    found = measure("depth", target + 2, target, target > 0, options={"bias": {"power": 3.0}})
    assert found["bias"].tolist() == [8.0, 8.0]

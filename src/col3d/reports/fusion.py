"""Results of a fusion: a table on screen, and an HTML page with surfaces that can be rotated."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from col3d.reports.run_page import as_script, write_page
from col3d.reports.scenes import Scene
from col3d.reports.screen import plain_console

ROWS = {
    "accuracy_mean_mm": "accuracy, mean mm",
    "accuracy_median_mm": "accuracy, median mm",
    "completeness_mean_mm": "completeness, mean mm",
    "completeness_median_mm": "completeness, median mm",
    "accurate_within_1_mm": "accurate within 1 mm",
    "complete_within_1_mm": "complete within 1 mm",
    "accurate_within_2_mm": "accurate within 2 mm",
    "complete_within_2_mm": "complete within 2 mm",
    "accurate_within_5_mm": "accurate within 5 mm",
    "complete_within_5_mm": "complete within 5 mm",
    "f_score_2_mm": "F score at 2 mm",
}
Comparisons = Mapping[str, Mapping[str, float]]
"""Metrics in mm or as shares, by the name of the comparison."""


def print_fusion(result: Mapping[str, Any], written: Sequence[Path]) -> None:
    """Print a column for each comparison, and the paths."""
    if result["comparisons"]:
        scale = f", prediction times {result['scale']:.3f}" if result.get("scale", 1.0) != 1.0 else ""
        table = Table(title=f"{result['frames']} frames{scale}", box=SIMPLE_HEAD, title_justify="left")
        table.add_column("")
        for name in result["comparisons"]:
            table.add_column(name, justify="right")
        for row in _rows(result["comparisons"]):
            table.add_row(*row)
        plain_console().print(table)
    else:
        print("nothing to compare with: one surface alone was fused, and the video has no coverage_mesh.obj")
    print("wrote", *map(str, written), sep="\n  ", flush=True)


def write_fusion_page(path: Path, result: Mapping[str, Any], scene: Scene) -> Path:
    """Write the results and the surfaces as one self-contained page."""
    facts = {
        "title": f"{scene.title}, fused",
        "result": result,
        "headings": ["", *result["comparisons"]],
        "rows": _rows(result["comparisons"]) if result["comparisons"] else [],
        "scenes": as_script([scene]),
    }
    return write_page(path, "fusion.html", facts)


def _rows(compared: Comparisons) -> list[list[str]]:
    return [[name, *(f"{values[key]:.3f}" for values in compared.values())] for key, name in ROWS.items()]

"""What a fusion found, on screen."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

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


def print_fusion(found: Mapping[str, Any], written: Sequence[Path]) -> None:
    """A column for each comparison, and the paths."""
    compared: Mapping[str, Mapping[str, float]] = found["comparisons"]
    if compared:
        scale = f", prediction times {found['scale']:.3f}" if found.get("scale", 1.0) != 1.0 else ""
        table = Table(title=f"{found['frames']} frames{scale}", box=SIMPLE_HEAD, title_justify="left")
        table.add_column("")
        for name in compared:
            table.add_column(name, justify="right")
        for key, name in ROWS.items():
            table.add_row(name, *(f"{values[key]:.3f}" for values in compared.values()))
        Console(width=120 if not Console().is_terminal else None, highlight=False).print(table)
    else:
        print("nothing to compare with: no checkpoint was given, and the video has no coverage_mesh.obj")
    print("wrote", *map(str, written), sep="\n  ", flush=True)

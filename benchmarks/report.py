"""Rows of numbers with their targets, as tables and as JSON."""

import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import torch
from rich.table import Table

from benchmarks.timing import Spread, spread_of
from col3d.reports.screen import plain_console
from col3d.runs.provenance import commit, versions

WIDTH = 100
TOLERANCE = 0.15


@dataclass(frozen=True)
class Row:
    """One measured number.

    Attributes:
        table: it stands in.
        name: of what was measured.
        unit: of the number.
        spread: over the repeats.
        at_least: what the median should reach.
        at_most: what it should not exceed.
    """

    table: str
    name: str
    unit: str
    spread: Spread
    at_least: float | None = None
    at_most: float | None = None

    @property
    def met(self) -> bool | None:
        """Whether the median keeps to the target; None without one."""
        if self.at_least is not None:
            return self.spread.median >= self.at_least
        return None if self.at_most is None else self.spread.median <= self.at_most

    @property
    def verdict(self) -> str:
        """The target, and whether it is met."""
        if self.met is None:
            return ""
        bound = f"at most {self.at_most:g}" if self.at_least is None else f"at least {self.at_least:g}"
        return f"{bound}: {'met' if self.met else 'MISSED'}"


def row(table: str, name: str, unit: str, values: Sequence[float], **target: float) -> Row:
    """A row of repeats."""
    return Row(table, name, unit, spread_of(values), **target)


def times(table: str, seconds: Mapping[str, Sequence[float]]) -> list[Row]:
    """A row in milliseconds for each of what was timed together."""
    return [row(table, name, "ms", [1000 * second for second in taken]) for name, taken in seconds.items()]


def show(rows: Iterable[Row]) -> None:
    """Print the tables."""
    console = plain_console(WIDTH)
    for title, group in groupby(rows, key=lambda line: line.table):
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        table.add_column(min_width=45)
        for name in ("median", "min", "max"):
            table.add_column(name, justify="right", min_width=8)
        table.add_column("target", min_width=20)
        for line in group:
            numbers = [_written(value) for value in asdict(line.spread).values()]
            table.add_row(f"{line.name}, {line.unit}", *numbers, line.verdict)
        console.print(table, "")


def write(path: Path, settings: dict[str, Any], rows: Iterable[Row]) -> None:
    """Write what was measured, how, and on what, as JSON."""
    lines = [asdict(line) | {"met": line.met} for line in rows]
    content = {"settings": settings, "machine": machine(), "rows": lines}
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def machine() -> dict[str, Any]:
    """What the numbers depend on beside the code."""
    device = torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"
    facts = {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()}
    return {**facts, "threads": torch.get_num_threads(), "device": device, "commit": commit(), **versions()}


def _processor() -> str:
    """Its name, and how wide its vectors are."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return f"{line.partition(': ')[2]}, {torch.backends.cpu.get_cpu_capability()}"
    return platform.processor()


def regressions(rows: Iterable[Row], baseline: Mapping[str, float]) -> list[str]:
    """A line for each ratio that is more than `TOLERANCE` worse than it was."""
    lines = []
    for line in rows:
        before, now = baseline.get(f"{line.table}: {line.name}"), line.spread.median
        if before is not None and line.unit == "x":
            worse = before / now if line.at_least is not None else now / before
            if worse > 1 + TOLERANCE:
                lines.append(f"{line.table}: {line.name}: {now:.3g}, and was {before:.3g}")
    return lines


def ratios_of(rows: Iterable[Row]) -> dict[str, float]:
    """What a later run is compared with."""
    return {f"{line.table}: {line.name}": round(line.spread.median, 4) for line in rows if line.unit == "x"}


def _written(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"

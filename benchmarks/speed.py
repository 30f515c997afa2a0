"""Measure networks, metrics, geometry, start-up and data; compare with the ratios of before: `make speed`."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import torch

from benchmarks.data_speed import add_options, data_rows
from benchmarks.kernels import floor_rows, geometry_rows, metric_rows
from benchmarks.networks import Case, network_rows, smallest
from benchmarks.pieces import piece_rows
from benchmarks.report import Row, ratios_of, regressions, show, write
from benchmarks.startup import startup_rows
from col3d.errors import DataError

BASELINE = Path(__file__).with_name("baseline.json")
PARTS = ("data", "floors", "networks", "metrics", "geometry", "pieces", "startup")


def main(arguments: Sequence[str] | None = None) -> list[Row]:
    """Measure, print, write, and say what has become slower.

    Raises:
        DataError: a file is not what it should be.
    """
    options = parser().parse_args(arguments)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    case = smallest(Case()) if options.smoke else Case()
    repeats = 1 if options.smoke else options.repeats
    parts: dict[str, Callable[[], list[Row]]] = {
        "floors": lambda: floor_rows(device, repeats),
        "networks": lambda: network_rows(case, device, repeats, compiled=not options.smoke),
        "metrics": lambda: metric_rows(case.side, device, repeats),
        "geometry": lambda: geometry_rows(case.side, device, repeats),
        "pieces": lambda: piece_rows(case.side, device, repeats),
        "startup": lambda: startup_rows(repeats),
        "data": lambda: data_rows(options, device),
    }
    rows = []
    for name in options.only:
        print(f"measuring {name}", flush=True)
        found = parts[name]()
        show(found)
        rows += found
    write(options.json, {name: str(value) for name, value in vars(options).items()}, rows)
    baseline = json.loads(options.baseline.read_text(encoding="utf-8"))["ratios"]
    slower = [] if options.smoke else regressions(rows, baseline)
    for line in slower:
        print(f"slower by more than 15 %: {line}")
    print(f"wrote {options.json}; {len(slower)} ratios have become worse than {options.baseline}")
    if options.keep:
        content = {"written_by": "python -m benchmarks.speed --keep", "ratios": baseline | ratios_of(rows)}
        options.baseline.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return rows


def parser() -> argparse.ArgumentParser:
    """What the program takes."""
    made = argparse.ArgumentParser("speed", description=__doc__)
    made.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts; all when absent")
    made.add_argument("--repeats", type=int, default=7, help="rounds that are counted")
    made.add_argument("--json", type=Path, default=Path("speed.json"), help="where the numbers go")
    made.add_argument("--baseline", type=Path, default=BASELINE, help="ratios to compare with")
    made.add_argument("--keep", action="store_true", help="make this run's ratios the baseline")
    made.add_argument("--smoke", action="store_true", help="smallest networks, one round: does it run?")
    add_options(made.add_argument_group("data"))
    return made


if __name__ == "__main__":
    try:
        main()
    except DataError as error:
        sys.exit(f"error: {error}")

"""Networks on a GPU: parity with the authors' numbers, speed beside the published code, where the time goes.

    COL3D_PARITY=/path/to/parity python -m benchmarks.gpu OUT

Stages run in the order of their worth, each within a limit of its own; a stage that fails writes its error,
and the next one runs. OUT/results.jsonl takes each result as soon as it is there, OUT/gpu.md all of them as
tables in Markdown, OUT/errors.txt the tracebacks of stages that failed.
"""

import argparse
import os
import platform
import shlex
import sys
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import torch

from benchmarks.gpu.results import Results
from benchmarks.gpu.setting import Setting, smallest
from benchmarks.gpu.stages import GROUPS, run_stages, stages
from col3d.errors import DataError
from col3d.runs.provenance import commit


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the stages.

    Returns:
        How many of them failed.

    Raises:
        DataError: CUDA or a stage is asked for, and there is none.
    """
    start = time.perf_counter()
    options = parser().parse_args(arguments)
    device = torch.device(options.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        raise DataError("--device: cuda needs a GPU that torch can use, and there is none; take cpu")
    setting = smallest(device) if options.quick else Setting(device)
    typed = shlex.join(sys.argv[1:] if arguments is None else arguments)
    results = Results(options.out, facts(device) | {"command": f"`python -m benchmarks.gpu {typed}`"})
    failed = run_stages(stages(options.only), setting, results, start + options.seconds)
    print(f"{options.out / 'gpu.md'}: {failed} stages failed, {time.perf_counter() - start:.0f} s")
    return failed


def facts(device: torch.device) -> dict[str, Any]:
    """What the numbers depend on beside the code."""
    cuda = device.type == "cuda"
    found: dict[str, Any] = {"device": torch.cuda.get_device_name(device) if cuda else platform.machine()}
    found |= {"torch": torch.__version__, "Python": platform.python_version(), "cores": os.cpu_count()}
    if cuda:
        found |= {"CUDA": torch.version.cuda, "cuDNN": torch.backends.cudnn.version()}
    return found | {"commit": commit() or "unknown", "date": date.today().isoformat()}


def parser() -> argparse.ArgumentParser:
    """What the program takes."""
    form = argparse.RawDescriptionHelpFormatter
    made = argparse.ArgumentParser("gpu", description=__doc__, formatter_class=form)
    made.add_argument("out", type=Path, help="folder of the results")
    made.add_argument("--device", choices=("cuda", "cpu"), default="cuda", help="where to compute")
    made.add_argument("--seconds", type=float, default=540.0, help="limit of all stages together")
    made.add_argument(
        "--only", nargs="+", default=GROUPS, help=f"{', '.join(GROUPS)}, or one of them, as speed:bts"
    )
    made.add_argument("--quick", action="store_true", help="smallest networks, one round: does it run?")
    return made


if __name__ == "__main__":
    try:
        sys.exit(1 if main() else 0)
    except DataError as error:
        sys.exit(f"error: {error}")

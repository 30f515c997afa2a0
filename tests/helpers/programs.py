"""The programs as a user calls them."""

import os
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[2]


def command(program: str) -> list[str]:
    """What starts a program: `train.py` of the checkout, or a word of the command `col3d`."""
    if program.endswith(".py"):
        return [sys.executable, str(PROJECT / program)]
    return [sys.executable, "-m", "col3d", program]


def call(program: str, *arguments: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run one, with its exit code and what it printed."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", **variables}
    return subprocess.run(
        [*command(program), *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )

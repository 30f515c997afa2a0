"""Programs that a signal is sent to."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from programs import command

SECONDS = 120


def stopped(
    program: str, *overrides: str, cwd: Path, signum: int, ready: Callable[[], bool] | signal.Signals
) -> tuple[int, str, str]:
    """Exit code and outputs of a program that a signal is sent to as soon as it is so far.

    Where `ready` is a signal: as soon as it has a handler for that one.
    """
    process = subprocess.Popen(
        [*command(program), *overrides],
        cwd=cwd,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + SECONDS
    while not (_listens(process.pid, ready) if isinstance(ready, signal.Signals) else ready()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signum)
    said, complained = process.communicate(timeout=SECONDS)
    return process.returncode, said, complained


def _listens(process: int, signum: signal.Signals) -> bool:
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    caught = next(line.split()[1] for line in lines if line.startswith("SigCgt:"))
    return bool(int(caught, 16) >> (signum - 1) & 1)

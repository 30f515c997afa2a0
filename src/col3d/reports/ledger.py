"""`python -m col3d.reports.ledger SWEEP`: what became of every job of a sweep."""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from col3d.io.run_files import STATES, Job, read_sweep
from col3d.registry.metric_specs import OURS
from col3d.reports.screen import plain_console
from col3d.reports.summary import LOG_WIDTH

EXIT_CODE = 2
STYLES = {"done": "green", "running": "cyan", "failed": "red", "missing": "dim"}
SCORE = "abs_rel"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run from the command line; bad input ends in one line and exit code 2."""
    parser = argparse.ArgumentParser(prog="python -m col3d.reports.ledger", description=__doc__)
    parser.add_argument("sweep", type=Path, metavar="SWEEP", help="folder of a sweep: its hydra.sweep.dir")
    sweep = parser.parse_args(arguments).sweep
    jobs = read_sweep(sweep) if sweep.is_dir() else []
    if not jobs:
        fault = "holds no job" if sweep.is_dir() else "is no folder"
        print(f"error: SWEEP: {sweep} {fault}; give the hydra.sweep.dir of a sweep", file=sys.stderr)
        return EXIT_CODE
    print_ledger(jobs)
    return 0


def print_ledger(jobs: Sequence[Job], console: Console | None = None) -> None:
    """Print a row for each job, and the number of jobs in each state."""
    console = console or plain_console()
    if not console.is_terminal:
        console.width = max(console.width, LOG_WIDTH)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("job", overflow="fold")
    table.add_column("state", no_wrap=True)
    for heading in ("epochs", "time", f"best {OURS[SCORE].screen_title}"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("said last", overflow="fold")
    for job in jobs:
        state = Text(job.state, style=STYLES.get(job.state, "yellow"))
        table.add_row(Text(job.name), state, _epochs(job), _time(job), _score(job), Text(_remark(job)))
    console.print(table)
    counts = Counter(job.state for job in jobs)
    console.print(", ".join(f"{counts[state]} {state}" for state in STATES if counts[state]))


def _epochs(job: Job) -> str:
    epochs = job.status.get("epochs")
    return "" if epochs is None else f"{job.status.get('epoch', 0)}/{epochs}"


def _time(job: Job) -> str:
    seconds = job.status.get("seconds")
    if seconds is None:
        return ""
    minutes = int(seconds) // 60
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02} min"
    return f"{minutes} min {int(seconds) % 60:02} s"


def _score(job: Job) -> str:
    score = job.result["best"].get(f"val/{SCORE}") if job.result else None
    return "" if score is None else f"{score:.4f}"


def _remark(job: Job) -> str:
    """The error of a failed job; the process and host of a running one."""
    if job.state == "failed":
        return str(job.status.get("error", ""))
    if job.state == "running" and "process" in job.status:
        return f"process {job.status['process']} on {job.status.get('host', 'some host')}"
    return ""


if __name__ == "__main__":
    sys.exit(main())

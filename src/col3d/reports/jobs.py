"""What the folder of a training says of it: the files that it keeps while it runs and when it ends."""

import fcntl
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.reports.shapes import read_object

STATUS, RESULT, LOCK, PLAN = "status.json", "result.json", ".lock", "sweep.json"
TRAINING = "training"
"""What its folder is said to own its files as; see `col3d.io.ownership`."""
STATES = ("done", "running", "preempted", "cut off", "failed", "missing")
"""`cut off`: neither running nor ended, as after a power cut."""


@dataclass(frozen=True)
class Job:
    """One training of a sweep.

    Attributes:
        name: of its folder.
        state: one of `STATES`.
        status: what it said last; empty where it never ran.
        result: what it ended in; empty where it has not.
    """

    name: str
    state: str
    status: dict[str, Any]
    result: dict[str, Any]


def read_job(folder: Path) -> Job:
    """What became of the training of a folder."""
    status, result = read_plain(folder / STATUS), read_plain(folder / RESULT)
    return Job(folder.name, _state(folder, status, result), status, result)


def _state(folder: Path, status: dict[str, Any], result: dict[str, Any]) -> str:
    if is_locked(folder):
        return "running"
    if result:
        return "done"
    said = str(status.get("state", "missing"))
    return "cut off" if said in ("running", "done") else said


def is_locked(folder: Path) -> bool:
    """Whether another process holds the lock of a folder; not to be asked by the one that does."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    else:
        return False
    finally:
        os.close(descriptor)


def add_to_plan(sweep: Path, jobs: Mapping[str, Sequence[str]], command: str) -> None:
    """Note the jobs of a sweep: their folders and overrides; those of other commands stay.

    Raises:
        UserError: the folder has a file of others under the name of the plan.
    """
    sweep.mkdir(parents=True, exist_ok=True)
    with (sweep / LOCK).open("a") as lock:
        with suppress(OSError):  # a file system without locks
            fcntl.lockf(lock, fcntl.LOCK_EX)
        plan, owned = read_plain(sweep / PLAN), Owned(sweep, "sweep", "hydra.sweep.dir")
        if "jobs" in plan:
            owned.adopt(PLAN)
        owned.claim(PLAN)
        known = {**plan.get("jobs", {}), **{name: list(job) for name, job in jobs.items()}}
        commands = [*plan.get("commands", []), command]
        write_json(sweep / PLAN, {"commands": list(dict.fromkeys(commands)), "jobs": known})


def read_sweep(sweep: Path) -> list[Job]:
    """Every job that was planned or has a folder, in the order of their names."""
    begun = {
        path.parent.name
        for name in (STATUS, RESULT, LOCK)
        for path in sweep.glob(f"*/{name}")
        if path.is_file()
    }
    planned = read_plain(sweep / PLAN).get("jobs", {})
    return [read_job(sweep / name) for name in sorted(begun | set(planned))]


def read_plain(path: Path) -> dict[str, Any]:
    """A JSON object of the shape that the name of its file stands for; empty where there is none."""
    try:
        return read_object(path)
    except (OSError, ValueError):
        return {}

"""Jobs of a sweep: state of each training, read from the files in its folder."""

import fcntl
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.io.run_schemas import read_object

STATUS, RESULT, LOCK, PLAN = "status.json", "result.json", ".lock", "sweep.json"
TRAINING = "training"
"""Kind of owner of the files in the folder of a training; see `col3d.io.ownership`."""
STATES = ("done", "running", "preempted", "cut off", "failed", "missing")
"""`cut off`: neither running nor ended, as after a power cut."""


@dataclass(frozen=True)
class Job:
    """One training of a sweep.

    Attributes:
        name: name of its folder.
        state: one of `STATES`.
        status: content of status.json; empty if it never ran.
        result: content of result.json; empty if it has not ended.
    """

    name: str
    state: str
    status: dict[str, Any]
    result: dict[str, Any]


def read_job(folder: Path) -> Job:
    """Read the state of the training in a folder."""
    status, result = read_plain(folder / STATUS), read_plain(folder / RESULT)
    return Job(folder.name, _state(folder, status, result), status, result)


def _state(folder: Path, status: dict[str, Any], result: dict[str, Any]) -> str:
    if is_locked(folder):
        return "running"
    if result:
        return "done"
    recorded = str(status.get("state", "missing"))
    return "cut off" if recorded in ("running", "done") else recorded


def is_locked(folder: Path) -> bool:
    """Whether another process holds the lock of a folder; the process that holds it must not call this."""
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
    """Add jobs, as folders with their overrides, to the plan of a sweep; jobs of other commands stay.

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
    """Read a JSON object and check it by the name of its file; empty if it is absent or does not fit."""
    try:
        return read_object(path)
    except (OSError, ValueError):
        return {}

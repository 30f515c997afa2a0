"""Bookkeeping for `overwrite=true` in sweeps and benchmarks: each run is replaced only once."""

import os
from collections.abc import Iterable
from pathlib import Path

from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.io.run_files import RESULT, read_plain

RECORD = ".overwrite.json"
"""File in the folder of the runs: the finished runs that are replaced, by folder name."""
SET = "COL3D_OVERWRITES"
"""Environment variable of the jobs: the folder of their runs."""


def begin(runs: Path, names: Iterable[str], option: str) -> None:
    """Record the finished runs that jobs of these names replace, unless they are recorded already.

    Raises:
        UserError: a file of others has the name of the record.
    """
    known, owned = read_plain(runs / RECORD), Owned(runs, "overwrite", option)
    new = {name: _run_in(runs / name) for name in names if name not in known}
    owned.claim(RECORD)
    if new:
        write_json(runs / RECORD, {**known, **new})
    os.environ[SET] = str(runs.absolute())


def end(runs: Path) -> None:
    """Remove the record when all jobs are done: the next overwrite=true replaces all runs again."""
    Owned(runs, "overwrite", "overwrite").remove()
    os.environ.pop(SET, None)


def is_replaced(folder: Path) -> bool:
    """Whether the finished run in a folder has replaced the recorded one."""
    runs = folder.absolute().parent
    known = read_plain(runs / RECORD) if os.environ.get(SET) == str(runs) else {}
    return folder.name in known and _run_in(folder) not in (None, known[folder.name])


def _run_in(folder: Path) -> str | None:
    """Return the identifier of the finished run in a folder, "" if it has none; None without a run."""
    result = read_plain(folder / RESULT)
    return str(result.get("run", "")) if result else None

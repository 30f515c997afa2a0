"""Runs of a sweep or a benchmark are overwritten once, however often its command is given again."""

import os
from collections.abc import Iterable
from pathlib import Path

from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.reports.jobs import RESULT, read_plain

RECORD = ".overwrite.json"
"""In the folder of the runs: by their names, the finished runs that are replaced."""
SET = "COL3D_OVERWRITES"
"""In the environment of the jobs: the folder of their runs."""


def begin(runs: Path, names: Iterable[str], option: str) -> None:
    """Note the finished runs that jobs of these names replace, but those that are noted already.

    Raises:
        UserError: the folder has a file of others under the name of the record.
    """
    known, owned = read_plain(runs / RECORD), Owned(runs, "overwrite", option)
    new = {name: _run_in(runs / name) for name in names if name not in known}
    owned.claim(RECORD)
    if new:
        write_json(runs / RECORD, {**known, **new})
    os.environ[SET] = str(runs.absolute())


def end(runs: Path) -> None:
    """Forget them at the end of all jobs: the next overwrite=true replaces all runs again."""
    Owned(runs, "overwrite", "overwrite").remove()
    os.environ.pop(SET, None)


def is_replaced(folder: Path) -> bool:
    """Whether the finished run in a folder is the one that replaced what was noted there."""
    runs = folder.absolute().parent
    known = read_plain(runs / RECORD) if os.environ.get(SET) == str(runs) else {}
    return folder.name in known and _run_in(folder) not in (None, known[folder.name])


def _run_in(folder: Path) -> str | None:
    """By what the finished run in a folder is told from others; older ones have no name."""
    result = read_plain(folder / RESULT)
    return str(result.get("run", "")) if result else None

"""starts.json: a record of every start of a run, with the versions of code, packages and data."""

import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from col3d.data.fingerprint import data_state
from col3d.data.options import DataOptions
from col3d.io.json_files import write_json
from col3d.io.run_files import read_plain
from col3d.phantom.options import PhantomOptions
from col3d.registry.plugins import code as plugin_code
from col3d.registry.plugins import versions as plugin_versions
from col3d.runs.provenance import code_sum, command, commit, plugins, versions

STARTS = "starts.json"
Start = dict[str, Any]


def this_start(data: DataOptions, phantom: PhantomOptions, weight_files: Mapping[str, str]) -> Start:
    """Describe a start of this process: time, command, and versions of code, packages and data.

    Args:
        data: data sets to train and test on.
        phantom: options of rendered data.
        weight_files: files that the training begins from, by option.
    """
    given = {option: Path(name) for option, name in weight_files.items() if Path(name).is_file()}
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command(),
        "commit": commit(),
        "code": code_sum(),
        "packages": {**versions(), **plugins(), **plugin_versions()},
        "plugins": plugin_code(),
        "data": data_state(data, phantom)
        | {
            f"{option} {path}": f"{path.stat().st_size} bytes, {path.stat().st_mtime_ns}"
            for option, path in given.items()
        },
    }


class Starts:
    """The recorded starts of one run.

    Args:
        folder: folder of the run.

    Attributes:
        run: identifier that distinguishes this run from others in the folder.
        replacing: whether the last start was interrupted while it removed an earlier run.
        known: the recorded starts, the oldest first.
    """

    def __init__(self, folder: Path) -> None:
        content = read_plain(folder / STARTS)
        self.path = folder / STARTS
        self.run = str(content.get("run") or "")
        self.replacing = content.get("replacing") is True
        starts = content.get("starts")
        self.known: list[Start] = (
            [start for start in starts if isinstance(start, dict)] if isinstance(starts, list) else []
        )

    def begin_anew(self) -> None:
        """Take a new identifier, and record that the earlier run is being removed."""
        self.run, self.known, self.replacing = secrets.token_hex(8), [], True
        self._write()

    def add(self, start: Start) -> None:
        """Record a start."""
        self.run = self.run or secrets.token_hex(8)
        self.known, self.replacing = [*self.known, start], False
        self._write()

    def changes(self, now: Start | None = None) -> list[str]:
        """List the differences between successive starts; with `now`, from the last start to `now`."""
        starts = self.known if now is None else [*self.known[-1:], now]
        lines = (line for before, after in pairwise(starts) for line in _changes(before, after))
        return list(dict.fromkeys(lines))

    def _write(self) -> None:
        write_json(self.path, {"run": self.run, "replacing": self.replacing, "starts": self.known})


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    lines = []
    if before.get("commit") != after["commit"]:
        lines.append(f"commit {before.get('commit')} became {after['commit']}")
    elif before.get("code") != after["code"]:
        lines.append("files of the code changed")
    known = before.get("plugins")
    for name, code in after["plugins"].items():
        if isinstance(known, dict) and known.get(name, code) != code:
            lines.append(f"files of the plugin {name} changed")
    for group in ("packages", "data"):
        old, new = before.get(group), after[group]
        old = old if isinstance(old, dict) else {}
        for name in sorted(old.keys() | new.keys()):
            if old.get(name) != new.get(name):
                lines.append(_line(group, name, old.get(name), new.get(name)))
    return lines


def _line(group: str, name: str, old: str | None, new: str | None) -> str:
    if old is None or new is None:
        return f"{name} {'came' if old is None else 'is gone'}"
    return f"{name} {old} became {new}" if group == "packages" else f"{name} changed ({_sizes(old, new)})"


def _sizes(old: str, new: str) -> str:
    """Describe the change of a file's size or date, without checksums, which mean nothing to a reader."""
    sizes = [text.rpartition(", ")[0] for text in (old, new)]
    return f"{sizes[0]}, now {sizes[1]}" if sizes[0] != sizes[1] else f"{sizes[0]}, of another time"

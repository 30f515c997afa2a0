"""Write folders atomically, and replace only what this program wrote."""

import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from col3d.errors import DataError, naming

PARTIAL = ".partial-"
LISTS = {
    "phantom.json": r"\d{4,}_(color|occlusion|depth|normals|flow)\.(png|tiff)|pose\.txt|coverage_mesh\.obj",
    "index.json": r"(image|depth|normals|mask)\.npy",
}
"""Files that list the contents of a rendered or a prepared video -> pattern of the names of our files, for
lists that cannot be read."""


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A folder to fill, which replaces `folder` when the block succeeds, and is deleted otherwise.

    Raises:
        DataError: `folder` holds something that this program did not write; the block does not begin.
    """
    check_replaceable(folder)
    partial = folder.parent / f"{PARTIAL}{folder.name}-{os.getpid()}"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        with naming(folder):
            yield partial
        _remove(folder)
        partial.replace(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_replaceable(folder: Path) -> None:
    """Refuse a video's folder that holds anything that this program did not write.

    Raises:
        DataError: names the folder and what is in it.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise DataError(f"{folder} is no folder of this program and stays as it is; move it away")
    if folder.is_dir() and (others := sorted(_names(folder) - set(_written(folder)))):
        raise DataError(
            f"{folder} holds {others[0]}, which this program did not write and which stays as it is; move it "
            "elsewhere, and the same command makes the video anew"
        )


def _written(folder: Path) -> list[str]:
    """Names of a video's files that this program wrote; the list is last, and so is deleted last."""
    for name, pattern in LISTS.items():
        if (folder / name).is_file():
            listed = _listed(folder / name)
            if listed is None:
                listed = {file for file in _names(folder) if re.fullmatch(pattern, file)}
            return [*sorted(listed & _names(folder)), name]
    return []


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def _listed(path: Path) -> set[str] | None:
    """The files that a list names; None where it is truncated or damaged."""
    with suppress(OSError, ValueError, AttributeError, TypeError):
        content = json.loads(path.read_text(encoding="utf-8"))
        files = content["files"] if "files" in content else [f"{name}.npy" for name in content["shards"]]
        return {str(name) for name in files}
    return None


def _remove(folder: Path) -> None:
    """Delete a video that is to be replaced; foreign files that have come since stop it, and stay."""
    check_replaceable(folder)
    if folder.is_dir():
        for name in _written(folder):
            (folder / name).unlink()
        folder.rmdir()


def remove_stale(root: Path) -> None:
    """Delete folders that interrupted processes left; those of running processes and of others stay."""
    names = re.compile("|".join([*LISTS.values(), *map(re.escape, LISTS)]))
    for folder in root.glob(f"{PARTIAL}*-*"):
        process = folder.name.rpartition("-")[2]
        if not process.isdigit() or _is_running(int(process)) or folder.is_symlink() or not folder.is_dir():
            continue
        if all(names.fullmatch(name) for name in _names(folder)):
            shutil.rmtree(folder, ignore_errors=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

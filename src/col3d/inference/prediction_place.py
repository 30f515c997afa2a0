"""Check whether a prediction may write into a folder: it replaces only files of an earlier prediction."""

import json
import os
from contextlib import suppress
from pathlib import Path

from col3d.data.files.images import ImageSource
from col3d.errors import UserError
from col3d.inference.options import PredictOptions
from col3d.io.ownership import Owned

TABLE, SUMMARY, VIDEO, CHART = "predictions.csv", "summary.json", "side_by_side.mp4", "over_time.png"
FILES = (TABLE, SUMMARY, VIDEO, CHART)


PARTS = ("frames", "previews", "clouds", *FILES)
"""Names of all files and folders that a prediction writes."""


def check_room(path: Path, options: PredictOptions, source: ImageSource) -> Owned:
    """Return the earlier prediction in a folder, after checking that no other files would be lost.

    Raises:
        UserError: the folder cannot be used, or holds a complete prediction without `overwrite`.
    """
    if path.exists() and not path.is_dir():
        raise UserError(f"output: {path} is a file; name a folder")
    _check_parent(path)
    owned = Owned(path, "prediction", "output")
    for part in PARTS:
        ours = any(name.split("/")[0] == part for name in owned.names)
        if (path / part).exists() and not ours and not _is_empty_folder(path / part):
            raise UserError(
                f"output: {path} holds {part}, which is of no prediction of this program; name another folder"
            )
    written = {(path / name).resolve() for name in owned.existing()}
    if any(file.resolve() in written for file in source.paths):
        raise UserError(f"output: {path} holds the input, {options.input}; name another folder")
    ended = (path / SUMMARY).resolve() in written and not _is_lacking(path / SUMMARY)
    if ended and not options.overwrite:  # whether it was stopped early or not
        raise UserError(f"output: {path} holds a prediction already; name another folder or overwrite=true")
    return owned


def _check_parent(path: Path) -> None:
    """Refuse a folder that cannot be created, before anything is predicted."""
    existing = next(part for part in (path.absolute(), *path.absolute().parents) if part.exists())
    if not existing.is_dir():
        raise UserError(f"output: {path} cannot be made, for {existing} is a file; name another folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UserError(f"output: {path} cannot be made, for nothing can be written to {existing}")


def _is_empty_folder(path: Path) -> bool:
    """Whether a folder is empty, as after a prediction whose disk was full before its first frame."""
    return path.is_dir() and not path.is_symlink() and not any(path.iterdir())


def _is_lacking(summary: Path) -> bool:
    """Whether the summary of an earlier prediction lists parts that could not be made."""
    with suppress(OSError, ValueError, AttributeError):
        return bool(json.loads(summary.read_text(encoding="utf-8")).get("undone"))
    return False

"""Checkpoint files: there whole or not at all, and checked when they are read."""

import errno
import os
import pickle
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import torch
from lightning.fabric.plugins.io.torch_io import TorchCheckpointIO

from col3d.errors import UserError, error_chain
from col3d.io.atomic import BUFFER, whole_file


class DamagedError(Exception):
    """A file was cut short or changed."""


class CheckpointFiles(TorchCheckpointIO):
    """How Lightning saves: into a file beside, which replaces the old one once it is on the disk."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        """Save, or leave what is there as it is.

        Raises:
            OSError: the disk is full, or may not be written to.
        """
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with whole_file(path) as file:
                torch.save(checkpoint, file)
        except BaseException as error:
            raise _cause(error, path) from None
        folder = os.open(path.parent, os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)


def _cause(error: BaseException, path: Path) -> BaseException:
    """What a full disk really raised, where torch's writer hides it behind an error of its own."""
    for hidden in error_chain(error):
        if isinstance(hidden, OSError):
            return OSError(hidden.errno, hidden.strerror, str(path))
    return error


def _check_sums(path: Path, file: BinaryIO) -> None:
    """Hold every byte of a checkpoint against the sums that are stored with it.

    Raises:
        DamagedError: the file is not as it was saved.
    """
    with _named_damage(path), zipfile.ZipFile(file) as archive:
        if (damaged := archive.testzip()) is not None:
            raise DamagedError(f"{path}: {damaged} in it has changed")


@contextmanager
def _named_damage(path: Path) -> Iterator[None]:
    """What zip and torch raise over bytes that make no sense, as damage of the file."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.EINVAL:  # a place in the file that cannot be
            raise
        raise DamagedError(f"{path}: {error.strerror}") from None
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, ValueError) as error:
        raise DamagedError(f"{path}: {' '.join(str(error).split())[:200]}") from None


def read_checkpoint(path: Path) -> dict[str, Any]:
    """A checkpoint of a training, with every byte checked and opened as tensors and plain values only.

    Raises:
        DamagedError: the file is not as it was saved.
        UserError: it is a file of something else, or holds what only a pickle that runs code can hold.
    """
    try:
        with path.open("rb", buffering=BUFFER) as file:
            _check_sums(path, file)
            file.seek(0)
            with _named_damage(path):
                content = torch.load(file, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        raise UserError(f"{path} holds more than tensors and plain values, and is not opened") from None
    if not isinstance(content, dict) or not {"state_dict", "epoch", "loops"} <= content.keys():
        raise UserError(f"{path} is not a checkpoint of a training")
    if not _are_rows(content.get("rows", [])):
        raise UserError(f"{path} is not a checkpoint of a training: its table of epochs is broken")
    return content


def _are_rows(rows: Any) -> bool:
    """Whether these are the epochs of a training as `RowsInCheckpoints` keeps them."""
    return isinstance(rows, list) and all(
        isinstance(row, dict) and isinstance(row.get("epoch"), int) for row in rows
    )


def run_of(content: Mapping[str, Any]) -> str | None:
    """The run that a checkpoint is of; None where it does not say."""
    about = content.get("about")
    found = about.get("run") if isinstance(about, Mapping) else None
    return found if isinstance(found, str) else None

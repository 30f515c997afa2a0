"""Reading and writing of checkpoint files: written atomically, and verified when they are read."""

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
    """A checkpoint file was truncated or changed."""


class CheckpointFiles(TorchCheckpointIO):
    """Checkpoint plugin of Lightning that saves atomically, by a temporary file in the same folder."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        """Save the checkpoint, or leave the previous one unchanged on failure.

        Raises:
            OSError: the disk is full or not writable.
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
    """Return the OSError behind an error of torch's writer, such as that of a full disk, or the error."""
    for hidden in error_chain(error):
        if isinstance(hidden, OSError):
            return OSError(hidden.errno, hidden.strerror, str(path))
    return error


def _check_sums(path: Path, file: BinaryIO) -> None:
    """Verify a checkpoint by the checksums that are stored in its archive.

    Raises:
        DamagedError: the file is not as it was saved.
    """
    with _named_damage(path), zipfile.ZipFile(file) as archive:
        if (damaged := archive.testzip()) is not None:
            raise DamagedError(f"{path}: {damaged} in it has changed")


@contextmanager
def _named_damage(path: Path) -> Iterator[None]:
    """Convert errors of zip and torch about invalid content in the block to `DamagedError`."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.EINVAL:  # EINVAL: an invalid position in the file
            raise
        raise DamagedError(f"{path}: {error.strerror}") from None
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, ValueError) as error:
        raise DamagedError(f"{path}: {' '.join(str(error).split())[:200]}") from None


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint of a training, after verifying it, as tensors and plain values only.

    Raises:
        DamagedError: the file is not as it was saved.
        UserError: it is not a checkpoint of a training, or holds objects that only a pickle which runs code
            can hold.
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
    """Whether a value is a list of epochs' rows, as `RowsInCheckpoints` keeps them."""
    return isinstance(rows, list) and all(
        isinstance(row, dict) and isinstance(row.get("epoch"), int) for row in rows
    )


def run_of(content: Mapping[str, Any]) -> str | None:
    """Return the identifier of a checkpoint's run; None if it has none."""
    about = content.get("about")
    run = about.get("run") if isinstance(about, Mapping) else None
    return run if isinstance(run, str) else None

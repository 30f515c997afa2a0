"""Check that a file of weights is undamaged, and that weights are finite numbers."""

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from col3d.io.atomic import BUFFER

ARCHIVE = b"PK\x03\x04"
"""First bytes of the archives of torch.save."""


def check_archive(path: Path) -> None:
    """Verify the checksums in an archive of torch.save.

    Files of other formats have no checksums, and pass.

    Raises:
        ValueError: names the file and the damaged entry.
    """
    if not zipfile.is_zipfile(path):
        _check_end(path)
        return
    try:
        with path.open("rb", buffering=BUFFER) as file, zipfile.ZipFile(file) as archive:
            damaged = archive.testzip()
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, ValueError, OSError) as error:
        raise ValueError(f"{path} is damaged ({' '.join(str(error).split())[:120]}); copy it again") from None
    if damaged is not None:
        raise ValueError(f"{path} is damaged, {damaged} in it has changed; copy it again")


def _check_end(path: Path) -> None:
    """Refuse a truncated archive: its table of contents at the end is cut off first.

    Raises:
        ValueError: names the file.
    """
    with path.open("rb") as file:
        head = file.read(len(ARCHIVE))
    if head == ARCHIVE:
        raise ValueError(f"{path} is damaged: the file is cut off; copy it again")
    if not head:
        raise ValueError(f"{path} is damaged: the file is empty; copy it again")


def check_finite(tensors: Mapping[Any, Any]) -> None:
    """Refuse weights that are not dense tensors of finite real numbers, as float32 holds them.

    Raises:
        ValueError: names the first of them.
    """
    for name, values in tensors.items():
        if not isinstance(name, str):
            raise ValueError(f"{name!r} is no name of a tensor")
        if not isinstance(values, Tensor):
            raise ValueError(f"{name} is no tensor but a {type(values).__name__}")
        if values.layout != torch.strided or values.is_meta or values.is_quantized or values.is_complex():
            raise ValueError(f"{name} is no dense tensor of real numbers ({values.layout}, {values.dtype})")
        if values.is_floating_point() and not bool(values.float().isfinite().all()):
            raise ValueError(f"{name} is not finite: the file is damaged, or its training diverged")


def check_fractions(given: Mapping[str, Any], wanted: Mapping[str, Tensor]) -> None:
    """Refuse integers as weights of a network, which loading would convert silently.

    Raises:
        ValueError: names the first of them.
    """
    for name in wanted:
        if name in given and wanted[name].is_floating_point() and not given[name].is_floating_point():
            raise ValueError(f"{name} holds whole numbers ({given[name].dtype}), and weights are fractions")

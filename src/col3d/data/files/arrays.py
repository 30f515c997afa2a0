"""Read arrays from NPY, NPZ and PFM files, and their headers; nothing in the files is ever executed."""

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from col3d.data.files.decode import refusals
from col3d.errors import DataError

NPY, NPZ, PFM = b"\x93NUMPY", b"PK\x03\x04", (b"Pf", b"PF")
PFM_HEADER = re.compile(rb"(P[fF])\s+(\d{1,7})\s+(\d{1,7})\s+([-+]?[0-9.]+(?:[eE][-+]?\d+)?)\s")
NPY_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


@dataclass(frozen=True)
class ArrayHeader:
    """Shape and type of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype


def is_array(path: Path) -> bool:
    """Whether a file begins as NPY, NPZ or PFM; False where there is no file."""
    try:
        with path.open("rb") as file:
            head = file.read(6)
    except OSError:
        return False
    return head == NPY or head[:4] == NPZ or head[:2] in PFM


def array_header(path: Path) -> ArrayHeader:
    """Shape and type of a file's array; the file has to be as long as they require.

    Raises:
        DataError: names the file and what is wrong with it.
    """
    with refusals(path):
        head = _head(path)
        if head == NPY:
            with path.open("rb") as file:
                header, start = _npy_header(file), file.tell()
            return _long_enough(path, header, start)
        if head[:4] == NPZ:
            return _packed_header(path)
        dtype, shape, start = _pfm_header(path)
        return _long_enough(path, ArrayHeader(shape, dtype), start)


def read_array(path: Path) -> np.ndarray:
    """The array of a file.

    Raises:
        DataError: as `array_header`, or a checksum is wrong.
    """
    header = array_header(path)
    with refusals(path):
        head = _head(path)
        if head == NPY:
            return np.asarray(np.load(path, allow_pickle=False))
        if head[:4] == NPZ:
            with np.load(path, allow_pickle=False) as arrays:
                return np.asarray(arrays[arrays.files[0]])
        kind, shape, start = _pfm_header(path)
        rows = np.fromfile(path, kind, int(np.prod(header.shape)), offset=start).reshape(shape)
        return rows[::-1].astype(np.float32)  # the lowest row comes first


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(6)


def _packed_header(path: Path) -> ArrayHeader:
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        if len(names) != 1:
            listed = ", ".join(name.removesuffix(".npy") for name in names[:5])
            raise DataError(f"{path}: expected an NPZ of one array, got {len(names)} ({listed})")
        with archive.open(names[0]) as file:
            return _npy_header(file)


def _npy_header(file: Any) -> ArrayHeader:
    version = np.lib.format.read_magic(file)
    if version not in NPY_HEADERS:
        raise ValueError(f"version {version} of NPY is not known")
    shape, _, dtype = NPY_HEADERS[version](file)
    return ArrayHeader(shape, dtype)


def _long_enough(path: Path, header: ArrayHeader, start: int) -> ArrayHeader:
    count = int(np.prod(header.shape, dtype=np.int64))
    if not header.dtype.hasobject and path.stat().st_size < start + header.dtype.itemsize * count:
        raise DataError(f"{path}: the file is cut off; copy it again")
    return header


def _pfm_header(path: Path) -> tuple[np.dtype, tuple[int, ...], int]:
    """Type, shape and offset of the data; the sign of the scale determines the byte order."""
    with path.open("rb") as file:
        match = PFM_HEADER.match(file.read(256))
    if match is None:
        raise ValueError("its header is none of PFM")
    width, height = int(match[2]), int(match[3])
    shape = (height, width) if match[1] == b"Pf" else (height, width, 3)
    return np.dtype("<f4" if float(match[4]) < 0 else ">f4"), shape, match.end()

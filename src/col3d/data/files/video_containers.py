"""Recognise containers of video by their first bytes, and read the file length that they declare."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide")
"""First boxes of MP4 and QuickTime files."""
EBML, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
ASF = bytes.fromhex("3026b2758e66cf11a6d900aa0062ce6c")
KLV = bytes.fromhex("060e2b34")
"""First bytes of every key of MXF."""
FLV_SIZE = b"\x00\x08filesize\x00"
"""Bytes before the length of the file, a double, in the first tag of many FLV files."""
HEAD = 65536
"""Bytes at the beginning that hold that tag."""
PACKETS = ((0, 188), (4, 192))
"""Offset of the first sync byte of a transport stream, and distance to the next."""


def container_of(path: Path) -> str:
    """Name of the container that a file begins as; empty where it is not a known one.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
    if head[4:8] in BOXES:
        return "MP4"
    if head[:4] == b"RIFF" and head[8:12] != b"WEBP":
        return "AVI"
    if any(head[at : at + 1] == b"G" == head[at + step : at + step + 1] for at, step in PACKETS):
        return "MPEG transport stream"
    starts = {EBML: "Matroska", b"FLV\x01": "FLV", ASF: "ASF", KLV: "MXF", b"OggS": "Ogg"}
    starts |= {b"\x00\x00\x01\xba": "MPEG program stream"}
    return next((name for start, name in starts.items() if head.startswith(start)), "")


def declared_length(path: Path) -> int | None:
    """Length of the file in bytes that its container declares; None where it declares none.

    Raises:
        OSError: the file cannot be read.
    """
    measure = MEASURES.get(container_of(path))
    if measure is None:
        return None
    with path.open("rb") as file:
        return measure(file, path.stat().st_size)


def missing_bytes(path: Path) -> int:
    """Number of bytes that a container declares beyond the end of its file; 0 where it declares none.

    Raises:
        OSError: the file cannot be read.
    """
    return max(0, (declared_length(path) or 0) - path.stat().st_size)


def _boxes(file: BinaryIO, size: int) -> int | None:
    at = 0
    while at + 8 <= size:
        file.seek(at)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        if length < 8:  # 0: to the end of the file
            return None
        at += length
    return at


def _riffs(file: BinaryIO, size: int) -> int | None:
    end = 0
    while end + 8 <= size:
        file.seek(end + end % 2)
        head = file.read(8)
        length = int.from_bytes(head[4:8], "little")
        if head[:4] != b"RIFF" or length == 0:
            return end or None
        end += end % 2 + 8 + length
    return end


def _segment(file: BinaryIO, size: int) -> int | None:
    file.seek(4)
    file.seek(_number(file) or 0, 1)
    if file.read(4) != SEGMENT:
        return None
    length = _number(file)
    return None if length is None else file.tell() + length


def _number(file: BinaryIO) -> int | None:
    """A number of variable length of EBML; None where it stands for an unknown length."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    width = 9 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] & (0xFF >> width)]) + file.read(width - 1), "big")
    return None if value == (1 << 7 * width) - 1 else value


def _tags(file: BinaryIO, size: int) -> int:
    """Length of an FLV file: what its first tag declares, or else the end of the last tag that begins."""
    head = file.read(HEAD)
    place = head.find(FLV_SIZE)
    length_field = head[place + len(FLV_SIZE) :][:8] if place >= 0 else b""
    if len(length_field) == 8 and 0 < (length := struct.unpack(">d", length_field)[0]) < 2**63:
        return int(length)
    at = int.from_bytes(head[5:9], "big") + 4
    while at < size:
        file.seek(at)
        at += 11 + int.from_bytes(file.read(4)[1:], "big") + 4
    return at


def _objects(file: BinaryIO, size: int) -> int | None:
    """Length of an ASF file: the end of the last object that begins."""
    at = 0
    while at < size:
        file.seek(at)
        head = file.read(24)
        length = int.from_bytes(head[16:24], "little")
        if len(head) == 24 and length < 24:  # as in a broadcast
            return None
        at += max(length, 24)
    return at


def _keys(file: BinaryIO, size: int) -> int | None:
    """Length of an MXF file: the end of the last value that begins."""
    at = 0
    while at < size:
        file.seek(at)
        head = file.read(25)
        if not head.startswith(KLV):
            return None
        wide = head[16] - 0x80 if len(head) > 16 and head[16] > 0x80 else 0
        length = int.from_bytes(head[17 : 17 + wide], "big") if wide else int.from_bytes(head[16:17], "big")
        at += 17 + wide + length
    return at


MEASURES: dict[str, Callable[[BinaryIO, int], int | None]] = {
    "MP4": _boxes,
    "AVI": _riffs,
    "Matroska": _segment,
    "FLV": _tags,
    "ASF": _objects,
    "MXF": _keys,
}
"""Functions that measure the declared length, by container."""

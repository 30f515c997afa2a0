"""Read pose.txt: 16 numbers a line, one line a frame, in text of any program."""

import codecs
import re
from collections.abc import Mapping
from pathlib import Path

UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte order marks with which Windows begins a redirected text."""
SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
WANTED = 16
OTHER_FORMS: Mapping[int, str] = {
    4: "write the four rows of a matrix into one line",
    7: "turn quaternions into rotations, for nothing in them tells whether the scalar is first or last",
    8: "turn quaternions into rotations, for nothing in them tells whether the scalar is first or last",
    12: "append 0,0,0,1 to lines of 12",
    17: "leave out the number or time before each matrix",
}
"""Count of numbers in a line -> how to make it a line of 16."""


def pose_lines(path: Path) -> list[str]:
    """Lines of the file, without a byte order mark and without empty ones at the end.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no text.
    """
    content = path.read_bytes()
    try:
        text = content.decode("utf-16" if content.startswith(UTF_16) else "utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("it is no text in UTF-8") from None
    return text.rstrip().splitlines()


def numbers_of(line: str) -> list[float]:
    """Parse numbers that are separated by commas, semicolons, spaces or tabs.

    Raises:
        ValueError: the line is empty or holds something else.

    >>> numbers_of("1.0, -2e-3;3 4")
    [1.0, -0.002, 3.0, 4.0]
    """
    if not line.strip():
        raise ValueError("is empty")
    words = SEPARATOR.split(line.strip())
    if other := next((word for word in words if not NUMBER.fullmatch(word)), None):
        raise ValueError(f"has {other[:40]!r}, which is no number")
    if "" in words:
        raise ValueError("lacks a number between two commas, or at an end")
    return [float(word) for word in words]


def pose_rows(path: Path) -> list[list[float]]:
    """The 16 numbers of each line.

    Raises:
        OSError: the file cannot be read.
        ValueError: names the first line that is not, and the remedy.
    """
    rows = []
    for place, line in enumerate(pose_lines(path), start=1):
        try:
            rows.append(numbers_of(line))
        except ValueError as error:
            hint = "; take headers and comments out" if not rows else ""
            raise ValueError(f"line {place} {error}{hint}") from None
    if not rows:
        raise ValueError("the file is empty")
    counts = {len(row) for row in rows}
    if counts == {WANTED}:
        return rows
    if len(counts) == 1:
        count = counts.pop()
        remedy = f"; {OTHER_FORMS[count]}" if count in OTHER_FORMS else ""
        raise ValueError(f"got {len(rows)} lines of {count}{remedy}")
    place = next(i for i, row in enumerate(rows) if len(row) != len(rows[0]) or len(row) != WANTED)
    raise ValueError(f"line {place + 1} has {len(rows[place])}")

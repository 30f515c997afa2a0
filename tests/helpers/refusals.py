"""Errors by their type and by what they name, so that the prose around it may change without any test."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import pytest

E = TypeVar("E", bound=BaseException)


@dataclass(frozen=True)
class Refusal:
    """The one line that a program ends with: what it is about, and all of it."""

    about: str
    message: str


def subject(message: str) -> str:
    """The text before the first `: ` of the first line."""
    head, colon, _ = message.partition("\n")[0].partition(": ")
    return head if colon else ""


def says(message: str, named: object) -> bool:
    """Whether a value is in a message; a number stands there by itself: 3 is not in 13, 3.5 or `v3`."""
    if isinstance(named, int | float):
        return re.search(rf"(?<![\w.]){re.escape(str(named))}(?!\w|\.\d)", message) is not None
    return str(named) in message


@contextmanager
def refused(
    kind: type[E] | tuple[type[E], ...], about: object | None, *named: object
) -> Iterator[pytest.ExceptionInfo[E]]:
    """Expect an error of a kind that is about an option, argument, file or folder and names some values.

    Who meets an error acts on these facts, so tests ask for them; a sentence that is copied into a test says
    nothing more and has to be changed in two places. `about` is None where the message begins with no name.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    message = str(error)
    if about is not None:
        assert getattr(error, "about", subject(message)) == str(about), message
    missing = [value for value in named if not says(message, value)]
    assert not missing, f"{missing} not in: {message}"


def refusal(stderr: str) -> Refusal:
    """Read the one line `error: ...` of a program that refuses."""
    lines = stderr.splitlines()
    assert len(lines) == 1, stderr
    assert lines[0].startswith("error: "), stderr
    message = lines[0].removeprefix("error: ")
    return Refusal(subject(message), message)

"""Remove names of folders, users and hosts from content that is meant to be shared."""

import getpass
import re
import shlex
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

ABOVE = r"(?:file://)?(?:~[\w.-]*|(?:\.\./)*\.\.)?/(?!/)"
"""Beginning of a path: at the root, at a home, or above the folder of the command."""
PLACE = re.compile(rf"(?<![\w.~/<]){ABOVE}[^\s'\"`,;:(){{}}\[\]<>|]+")
"""Such a path inside a text."""
UNNAMED = "folder"


def without_places(content: Any) -> Any:
    """Content in which absolute paths, in texts at any depth, are reduced to their last names.

    Paths below the folder of the command stay: `runs/default` says nothing of a machine.
    """
    if isinstance(content, str):
        return _text(content)
    if isinstance(content, Mapping):
        return {key: without_places(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [without_places(value) for value in content]
    return content


def command_without_places(command: str) -> str:
    """A command line without places; paths in it may be quoted for their spaces."""
    try:
        words = shlex.split(command)
    except ValueError:  # the command line was edited by hand
        return str(_text(command))
    return shlex.join([_word(word) for word in words])


def last_name(path: str) -> str:
    """The last name of a path, unless it is that of a user or a host."""
    name = Path(path).name
    return UNNAMED if not name or name in _names_here() or path.rstrip("/") == str(Path.home()) else name


def _word(word: str) -> str:
    option, equals, value = word.rpartition("=")
    return f"{option}{equals}{last_name(value) if _is_place(value) else _text(value)}"


def _text(text: str) -> str:
    if "\n" not in text and _is_place(text):
        return last_name(text)
    return PLACE.sub(lambda match: last_name(match[0]), text)


def _is_place(text: str) -> bool:
    """Whether a whole text is such a path, spaces included."""
    return bool(re.match(rf"{ABOVE}\S", text)) and not re.search(r"\s/|[,;]\s", text)


def _names_here() -> set[str]:
    names = {socket.gethostname(), "root", "home", "Users"}
    with suppress(OSError, KeyError):  # a container's user need not have a name
        names.add(getpass.getuser())
    return names

"""A record of the files in a folder that this program wrote: it replaces or deletes no others."""

import json
from collections.abc import Container, Iterable, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

from col3d.errors import UserError
from col3d.io.atomic import write_whole


class Owned:
    """The files of one kind of output in a folder, listed in a hidden file there before they are written.

    Args:
        folder: the folder, which need not exist yet.
        kind: kind of output, such as "training"; each kind has its own list and owns no file of another kind.
        option: the option that named the folder, for messages.
    """

    def __init__(self, folder: Path, kind: str, option: str) -> None:
        self.folder, self.kind, self.option = folder, kind, option
        self.list = folder / f".col3d_{kind}"
        self.names = dict.fromkeys(_names_in(self.list))

    def check(self, names: Iterable[str]) -> None:
        """Refuse names of files that exist already and are not in the list.

        Raises:
            UserError: names the folder and the file.
        """
        for name in names:
            if name not in self.names and (blocker := self._in_the_way(name)) is not None:
                raise UserError(
                    f"{self.option}: {self.folder} holds {blocker}, which is of no {self.kind} of "
                    "this program and stays as it is; name another folder"
                )

    def check_place(self) -> None:
        """Refuse a folder that is neither empty nor one where this kind of output was written before.

        Raises:
            UserError: names the folder and a file in it.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise UserError(f"{self.option}: {self.folder} is a file; name a folder")
        if not self.names and self.folder.is_dir():
            self.check(sorted(path.name for path in self.folder.iterdir() if path != self.list))

    def claim(self, *names: str) -> None:
        """Add files that are about to be written to the list; refuse those that exist and are not in it.

        Raises:
            UserError: names the folder and the file.
            OSError: the list cannot be written.
        """
        self.check(names)
        self.adopt(*names)

    def adopt(self, *names: str) -> None:
        """Add files to the list without a check, because their content shows that this program wrote them.

        A name is written with the line break before it, so that a truncated entry damages no other.

        Raises:
            OSError: the list cannot be written.
        """
        new = [name for name in names if name not in self.names]
        if not new:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            with self.list.open("ab", buffering=0) as file:
                text = "".join(f"\n{json.dumps(name)}" for name in new).encode("ascii")
                while text:
                    text = text[file.write(text) or 0 :]
        except OSError as error:
            error.filename = str(self.list)
            raise
        self.names.update(dict.fromkeys(new))

    def existing(self) -> Iterator[str]:
        """Names in the list whose files exist."""
        return (name for name in self.names if (self.folder / name).is_file())

    def remove(self, below: str = "", keep: Container[str] = ()) -> None:
        """Delete the listed files, and folders inside that become empty; files of others stay.

        Args:
            below: delete only names that begin with this.
            keep: names that stay.
        """
        gone = [name for name in self.names if name.startswith(below) and name not in keep]
        for name in gone:
            (self.folder / name).unlink(missing_ok=True)
            (self.folder / f"{name}.partial").unlink(missing_ok=True)
        inside = {parent for name in gone for parent in PurePosixPath(name).parents if parent.parts}
        for parent in sorted((self.folder / parent for parent in inside), reverse=True):
            with suppress(OSError):  # it holds a file of others, or was never made
                parent.rmdir()
        self.names = {name: None for name in self.names if name not in set(gone)}
        if gone:
            write_whole(self.list, "".join(f"\n{json.dumps(name)}" for name in self.names))

    def _in_the_way(self, name: str) -> str | None:
        """Return the name of what exists where a file, or one of its parent folders, should be written."""
        *parents, _ = [str(part) for part in reversed(PurePosixPath(name).parents)] + [name]
        files = [parent for parent in parents if (self.folder / parent).exists()]
        blocked = [parent for parent in files if not (self.folder / parent).is_dir()]
        if blocked:
            return blocked[0]
        path = self.folder / name
        return name if path.exists() or path.is_symlink() else None


def _names_in(path: Path) -> Iterator[str]:
    """Read the names in a list, without those that lead outside of the folder."""
    with suppress(OSError):
        for line in path.read_bytes().split(b"\n"):
            with suppress(ValueError):
                name = json.loads(line)
                inside = isinstance(name, str) and not PurePosixPath(name).is_absolute()
                if inside and ".." not in PurePosixPath(name).parts:
                    yield name

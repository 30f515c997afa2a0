"""Which files of a folder this program wrote: the only ones that it replaces or deletes."""

import json
from collections.abc import Container, Iterable, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

from col3d.errors import UserError
from col3d.io.atomic import write_whole


class Owned:
    """The files of one kind of output in a folder, named in a hidden file there before they are written.

    Args:
        folder: that need not be there yet.
        kind: of output, such as "training"; each kind has a list of its own, and owns none of another's.
        option: that named the folder, for messages.
    """

    def __init__(self, folder: Path, kind: str, option: str) -> None:
        self.folder, self.kind, self.option = folder, kind, option
        self.list = folder / f".col3d_{kind}"
        self.names = dict.fromkeys(_names_in(self.list))

    def check(self, names: Iterable[str]) -> None:
        """Refuse names that something else has.

        Raises:
            UserError: names the folder and the file.
        """
        for name in names:
            if name not in self.names and (found := self._in_the_way(name)) is not None:
                raise UserError(
                    f"{self.option}: {self.folder} holds {found}, which is of no {self.kind} of "
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
        """Say which files are about to be written, by names in the folder; refuse those that are not ours.

        Raises:
            UserError: names the folder and the file.
            OSError: the list cannot be written.
        """
        self.check(names)
        self.adopt(*names)

    def adopt(self, *names: str) -> None:
        """The same of files that are known to be ours by what they hold.

        A name is written with the line break before it: one that was cut off spoils no other.

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

    def there(self) -> Iterator[str]:
        """Names of our files that are there."""
        return (name for name in self.names if (self.folder / name).is_file())

    def remove(self, below: str = "", keep: Container[str] = ()) -> None:
        """Delete our files, and folders inside that become empty; what others put beside them stays.

        Args:
            below: what the names begin with.
            keep: those that stay.
        """
        gone = [name for name in self.names if name.startswith(below) and name not in keep]
        for name in gone:
            (self.folder / name).unlink(missing_ok=True)
            (self.folder / f"{name}.partial").unlink(missing_ok=True)
        inside = {parent for name in gone for parent in PurePosixPath(name).parents if parent.parts}
        for parent in sorted((self.folder / parent for parent in inside), reverse=True):
            with suppress(OSError):  # something of others is in it, or it was never made
                parent.rmdir()
        self.names = {name: None for name in self.names if name not in set(gone)}
        if gone:
            write_whole(self.list, "".join(f"\n{json.dumps(name)}" for name in self.names))

    def _in_the_way(self, name: str) -> str | None:
        """What is where a file is to be written, or where a folder of it should be."""
        *parents, _ = [str(part) for part in reversed(PurePosixPath(name).parents)] + [name]
        files = [parent for parent in parents if (self.folder / parent).exists()]
        blocked = [parent for parent in files if not (self.folder / parent).is_dir()]
        if blocked:
            return blocked[0]
        path = self.folder / name
        return name if path.exists() or path.is_symlink() else None


def _names_in(path: Path) -> Iterator[str]:
    """Names in a list that lead to no other folder."""
    with suppress(OSError):
        for line in path.read_bytes().split(b"\n"):
            with suppress(ValueError):
                name = json.loads(line)
                inside = isinstance(name, str) and not PurePosixPath(name).is_absolute()
                if inside and ".." not in PurePosixPath(name).parts:
                    yield name

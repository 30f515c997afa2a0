"""Unpack archives of videos into folders, atomically."""

import shutil
import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from threading import Event

from col3d.data.download.server import Interrupted
from col3d.data.download.transfer import CHUNK
from col3d.errors import DataError, naming

FOLDERS_OF_A_VIDEO = ("rgb", "depth", "normals", "optical_flow", "occlusions", "diffuse")
"""Folders inside a video: they never wrap the whole video in an archive."""
LITTER = ("__MACOSX", ".DS_Store")
ENCRYPTED = 0x1


def unpack(archive: Path, folder: Path, partial: Path, stop: Event) -> None:
    """Unpack an archive into a folder that does not exist yet.

    Folders that wrap all of its files are left out. Every entry's checksum is verified.

    Args:
        archive: a zip.
        folder: folder of the video.
        partial: a folder on the same disk, which becomes `folder` at the end; what is in it is deleted.
        stop: checked repeatedly; when it is set, unpacking ends.

    Raises:
        DataError: the archive is broken, or an entry would lead out of the folder.
        Interrupted: `stop` was set.
        OSError: it cannot be written, or the folder exists.
    """
    if partial.exists():
        shutil.rmtree(partial)
    try:
        with zipfile.ZipFile(archive) as content:
            entries = _entries(archive, content)
            for entry, inside in entries.items():
                _write(content, entry, partial / inside, stop)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise DataError(f"{archive}: not a whole archive ({error})") from None
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    partial.rename(folder)


def unpacked_bytes(archive: Path) -> int:
    """Unpacked bytes of an archive.

    Raises:
        DataError: it is no archive.
    """
    try:
        with zipfile.ZipFile(archive) as content:
            return sum(entry.file_size for entry in content.infolist())
    except (zipfile.BadZipFile, EOFError) as error:
        raise DataError(f"{archive}: not a whole archive ({error})") from None


def _entries(archive: Path, content: zipfile.ZipFile) -> dict[zipfile.ZipInfo, PurePosixPath]:
    """Files of an archive, and the path of each in the folder of its video."""
    paths = {}
    for entry in content.infolist():
        path = _checked(archive, entry)
        if not entry.is_dir() and not set(path.parts) & set(LITTER):
            paths[entry] = path
    if not paths:
        raise DataError(f"{archive}: there is no file in it")
    while len(wrappers := {path.parts[0] for path in paths.values()}) == 1 and _wraps(paths, *wrappers):
        paths = {entry: path.relative_to(path.parts[0]) for entry, path in paths.items()}
    if len(set(paths.values())) != len(paths):
        raise DataError(f"{archive}: a file is in it twice")
    return paths


def _wraps(entries: dict[zipfile.ZipInfo, PurePosixPath], name: str) -> bool:
    return name not in FOLDERS_OF_A_VIDEO and all(len(path.parts) > 1 for path in entries.values())


def _checked(archive: Path, entry: zipfile.ZipInfo) -> PurePosixPath:
    """Path of an entry.

    Raises:
        DataError: it leads out of the folder, or the entry is no plain file, or is encrypted.
    """
    name = entry.orig_filename.replace("\\", "/")
    path = PurePosixPath(name)
    leads_out = path.is_absolute() or ".." in path.parts or ":" in name or "\0" in name
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if leads_out or kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise DataError(
            f"{archive}: the entry {entry.orig_filename!r} leads out of its folder; nothing was unpacked"
        )
    if entry.flag_bits & ENCRYPTED:
        raise DataError(f"{archive}: the entry {entry.orig_filename!r} is encrypted")
    return path


def _write(content: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path, stop: Event) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with content.open(entry) as source, naming(path), path.open("wb") as target:
        while chunk := source.read(CHUNK):
            if stop.is_set():
                raise Interrupted
            target.write(chunk)

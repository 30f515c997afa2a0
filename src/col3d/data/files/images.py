"""Sources of images: a file, a folder, a pattern, a video file, or a video of a data set."""

import glob
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.simcol3d import SimCol3D
from col3d.data.files.headers import read_header
from col3d.data.files.photos import Photos, choose_photos, is_photo_folder, kind_by_name
from col3d.data.files.sources import ImageSource, SourceImage, check_sides, read_image
from col3d.data.files.video_containers import container_of
from col3d.data.files.video_files import VideoFile, as_pictures
from col3d.errors import DataError, DiskError
from col3d.io.formats import MOVING_FORMATS, image_format

__all__ = [
    "ImageFiles",
    "ImageSource",
    "SourceImage",
    "VideoFile",
    "check_sides",
    "image_source",
    "read_image",
]

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".ogv")
MAYBE_SEVERAL = (".png", ".tif", ".tiff", ".webp")
"""Endings of images that may hold several pictures."""
ANIMATED, HEAD = b"acTL", 65536
"""Chunk that marks an animated PNG, and the number of bytes within which it comes."""
NAMED = 3
"""Most files or folders that a message names."""


class ImageFiles(ImageSource):
    """Image files by number and name.

    Args:
        name: name of the source.
        files: files by number.
        is_video: whether they are frames of one video, named by their numbers.
        notes: lines on files that were left out.
    """

    def __init__(self, name: str, files: dict[int, Path], is_video: bool, notes: Sequence[str] = ()) -> None:
        self.name, self.files, self.is_video, self.count = name, files, is_video, len(files)
        self.paths = tuple(files.values())
        self.names = [f"{number:04d}" for number in files] if is_video else _names(list(files.values()))
        self.notes = tuple(note for note in (*notes, _note_of_several(self.paths)) if note)

    def sizes(self) -> Iterator[tuple[int, int]]:
        """Height and width of images by their headers, read lazily; broken images are skipped."""
        for path in self.paths:
            try:
                yield read_header(path).size_hw
            except DiskError:
                raise
            except DataError:
                continue

    def __iter__(self) -> Iterator[SourceImage]:
        for name, (number, path) in zip(self.names, self.files.items(), strict=True):
            try:
                yield SourceImage(name, number, read_image(path))
            except DiskError:
                raise
            except DataError as error:
                yield SourceImage(name, number, None, str(error))


def image_source(given: str) -> ImageSource:
    """The source of images that a path or pattern stands for.

    Raises:
        DataError: nothing exists there, or nothing that can be read as images.
    """
    path = Path(given)
    if path.is_dir():
        return _folder(path)
    if path.is_file():
        return _file(path)
    if any(sign in given for sign in "*?["):
        return _matching(given, path)
    raise DataError(f"input: no such file or folder: {given}")


def _file(path: Path) -> ImageSource:
    """An image, several in one file, or else a video: the content decides, not the name."""
    ending, container = path.suffix.lower(), container_of(path)
    if image_format(path) in MOVING_FORMATS or (ending in IMAGE_ENDINGS and not container):
        return as_pictures(path) or ImageFiles(path.stem, {0: path}, is_video=False)
    try:
        return VideoFile(path)
    except DataError as error:
        if ending in VIDEO_ENDINGS or container:
            raise
        raise DataError(f"{error}, and is no image either; input takes images, videos and folders") from None


def _matching(given: str, path: Path) -> ImageSource:
    """Photos that match a pattern; all images that match it, if none is a photo by its name."""
    pattern = str(Path(glob.escape(str(path.parent))) / path.name) if path.parent.is_dir() else given
    images = _images([Path(name) for name in glob.glob(pattern, recursive=True)])  # noqa: PTH207 - absolute or not
    if not images:
        raise DataError(f"input: {given} matches no image ({', '.join(IMAGE_ENDINGS)})")
    photos = choose_photos(images)
    if not photos.files:
        photos = Photos(tuple(images), {})
    name, files = path.parent.name or "images", dict(enumerate(photos.files))
    return ImageFiles(name, files, is_video=False, notes=[photos.note(given)])


def _folder(path: Path) -> ImageSource:
    """A video of a data set by the names of its files, else the photos in the folder or in one below."""
    for color in (C3VD.kinds["color"], SimCol3D.kinds["color"]):
        if files := color.find(path):
            others = {*_images(list(path.iterdir())), *_beside(path)} - {*files.values()}
            notes = [Photos((), _counted(others)).note(str(path))]
            return ImageFiles(path.name, dict(sorted(files.items())), is_video=True, notes=notes)
    images = _images(list(path.iterdir()))
    if not images:
        return _folder_below(path)
    photos = choose_photos(images)
    if not photos.files:
        kinds = ", ".join(photos.left_out)
        raise DataError(
            f"input: {path} holds no photo: its {len(images)} images are {kinds} by their names; a pattern "
            f"such as {path}/*{images[0].suffix} takes them all the same"
        )
    left_out = Counter(photos.left_out) + _counted(_beside(path))
    notes = [Photos((), left_out).note(str(path))]
    return ImageFiles(path.name, dict(enumerate(photos.files)), is_video=False, notes=notes)


def _folder_below(path: Path) -> ImageSource:
    """The folder of photos in a folder that holds no image itself, such as `rgb` beside `depth`."""
    below = sorted(inner for inner in path.iterdir() if inner.is_dir() and not inner.name.startswith("."))
    holding = [inner for inner in below if _images(list(inner.iterdir()))]
    if not holding:
        videos = sorted(file.name for file in path.iterdir() if file.suffix.lower() in VIDEO_ENDINGS)
        hint = f"; each of its {len(videos)} videos is an input, such as {path / videos[0]}" if videos else ""
        endings = ", ".join(IMAGE_ENDINGS)
        raise DataError(f"input: {path} holds no image ({endings}) and no video of C3VD{hint}")
    photos = [inner for inner in holding if not kind_by_name(inner.name)]
    called = [inner for inner in photos if is_photo_folder(inner.name)]
    chosen = called if len(called) == 1 else photos
    if len(chosen) != 1:
        listed = ", ".join(inner.name for inner in holding[:NAMED])
        raise DataError(
            f"input: {path} holds no image, but {len(holding)} folders of images ({listed}); name one of them"
        )
    source = _folder(chosen[0])
    source.name = path.name
    others = ", ".join(inner.name for inner in holding if inner != chosen[0])
    note = f"note: the images of {chosen[0]} are taken" + (f", and not those of {others}" if others else "")
    source.notes = (note, *source.notes)
    return source


def _beside(path: Path) -> list[Path]:
    """Images in folders below whose names are those of depth, normals and the like."""
    below = [inner for inner in path.iterdir() if inner.is_dir() and kind_by_name(inner.name)]
    return [image for inner in below for image in _images(list(inner.iterdir()))]


def _counted(paths: Iterable[Path]) -> Counter[str]:
    return Counter(kind_by_name(path.stem) or kind_by_name(path.parent.name) or "others" for path in paths)


def _note_of_several(paths: Sequence[Path]) -> str:
    """A line on files that hold more pictures than the one that is taken; empty where none does."""
    counts = {path: _pages(path) for path in paths if path.suffix.lower() in MAYBE_SEVERAL}
    several = [f"{path.name} ({count})" for path, count in counts.items() if count > 1]
    if not several:
        return ""
    listed = ", ".join(several[:NAMED]) + (", ..." if len(several) > NAMED else "")
    return (
        f"note: the first picture is taken of files that hold several: {listed}; as input=FILE all of one are"
    )


def _pages(path: Path) -> int:
    try:
        with path.open("rb") as file:
            if path.suffix.lower() == ".png" and ANIMATED not in file.read(HEAD):
                return 1
        return read_header(path).pages
    except (DataError, OSError):
        return 1  # a broken file is reported when it is read


def _images(paths: Sequence[Path]) -> list[Path]:
    chosen = [path for path in paths if path.suffix.lower() in IMAGE_ENDINGS and path.is_file()]
    return sorted((path for path in chosen if not path.name.startswith(".")), key=_by_numbers)


def _by_numbers(path: Path) -> list[tuple[int, int, str]]:
    """Sort key by which frame_9 comes before frame_10."""
    parts = re.split(r"(\d+)", str(path))
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def _names(paths: Sequence[Path]) -> list[str]:
    """Stems; where two files share one, the parts of paths that distinguish them."""
    stems = [_in_utf8(path.stem) for path in paths]
    if len(set(stems)) == len(stems):
        return stems
    absolute = [path.absolute() for path in paths]
    shared = Path(*_common([path.parent.parts for path in absolute]))
    parts = [path.relative_to(shared).parts for path in absolute]
    return _made_unique([_in_utf8("_".join(names)).replace(".", "_") for names in parts])


def _in_utf8(name: str) -> str:
    """A name in which bytes that are no UTF-8 are replaced by U+FFFD."""
    return os.fsencode(name).decode("utf-8", "replace")


def _made_unique(names: Sequence[str]) -> list[str]:
    """The names, with a number appended to repeated ones."""
    unique: list[str] = []
    for name in names:
        number, free = 2, name
        while free in unique:
            number, free = number + 1, f"{name}_{number}"
        unique.append(free)
    return unique


def _common(parts: Sequence[tuple[str, ...]]) -> list[str]:
    columns = zip(*parts, strict=False)
    shared: list[str] = []
    for column in columns:
        if len(set(column)) > 1:
            break
        shared.append(column[0])
    return shared

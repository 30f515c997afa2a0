"""Separate the photos of a folder from depth, normals, masks and other maps beside them.

Names such as `0001_depth.png`, `Depth_0001.png` or `mask01.png` decide. Where they say nothing, the type of
the pixels does: files of more than 8 bits a channel, or grey ones beside colours of the same numbers, are no
photos.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from col3d.data.files.decode import read_rgb8
from col3d.data.files.headers import Header, read_header
from col3d.errors import DataError

KINDS: Mapping[str, tuple[str, ...]] = {
    "depth": ("depth", "depths", "depthmap", "depthmaps", "disp", "disparity", "disparities", "zbuffer"),
    "normals": ("normals", "normalmap", "normalmaps"),
    "masks": ("mask", "masks", "seg", "segmentation", "segmentations", "label", "labels", "semantic"),
    "flow": ("flow", "flows", "opticalflow"),
    "occlusion": ("occlusion", "occlusions", "occ"),
    "coverage": ("coverage",),
    "truth": ("gt", "groundtruth"),
}
"""Kind of file that is no photo -> words in its name."""
MAYBE = "normal"
"""A word that may also mean healthy tissue; it means normals only beside a photo of the same name."""
PHOTO_WORDS = (
    *("rgb", "color", "colour", "colors", "colours", "image", "images", "img", "imgs", "im"),
    *("frame", "frames", "framebuffer", "buffer", "photo", "photos", "left"),
)
MOST_FAMILIES = 12
"""Most families of names in a folder for which pixels are examined; more of them are no layout."""
Family = tuple[Path, str, str]
"""Files with the same folder, name without its numbers, and ending."""
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


@dataclass(frozen=True)
class Photos:
    """Photos among the files of a folder.

    Attributes:
        files: the photos, in their order.
        left_out: number of files of each kind that is no photo.
    """

    files: tuple[Path, ...]
    left_out: Mapping[str, int]

    def note(self, place: str) -> str:
        """A line on what is left out; empty where nothing is."""
        if not self.left_out:
            return ""
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(self.left_out.items()))
        return f"note: {place}: left out, for they are no photos: {listed}"


def choose_photos(paths: Sequence[Path]) -> Photos:
    """The photos among images; all of them where names and headers show no other kind.

    Args:
        paths: the images, in their order.
    """
    kinds = {path: kind_by_name(path.stem) for path in paths}
    if len({path.parent for path in paths}) > 1:  # a pattern of several folders, such as `*/*/*.png`
        kinds = {path: kind or kind_by_name(path.parent.name) for path, kind in kinds.items()}
    plain = {_key(path.stem) for path, kind in kinds.items() if not kind and MAYBE not in _words(path.stem)}
    for path, kind in kinds.items():
        if not kind and MAYBE in _words(path.stem) and _key(path.stem) in plain:
            kinds[path] = "normals"
    kinds |= _kinds_by_type([path for path, kind in kinds.items() if not kind])
    files = tuple(path for path, kind in kinds.items() if not kind)
    return Photos(files, Counter(kind for kind in kinds.values() if kind))


def kind_by_name(stem: str) -> str:
    """The one of `KINDS` that a name indicates; empty where it indicates none."""
    words = set(_words(stem))
    return next((kind for kind, names in KINDS.items() if words & set(names)), "")


def is_photo_folder(name: str) -> bool:
    """Whether the name of a folder is one for photos."""
    return bool(set(_words(name)) & set(PHOTO_WORDS))


def _words(stem: str) -> list[str]:
    return [word.lower() for word in WORD.findall(stem)]


def _key(stem: str) -> str:
    """A name without the words for photos."""
    dull = {*PHOTO_WORDS, MAYBE}
    kept = WORD.sub(lambda match: "" if match[0].lower() in dull else match[0].lower(), stem)
    return re.sub(r"[^a-z0-9]+", " ", kept).strip()


def _kinds_by_type(paths: Sequence[Path]) -> dict[Path, str]:
    """Images that are no photos by their pixels, judged by the first file of each family of names."""
    families: dict[Family, list[Path]] = {}
    for path in paths:
        families.setdefault((path.parent, re.sub(r"\d+", "#", path.stem), path.suffix), []).append(path)
    headers = {family: _header(members[0]) for family, members in families.items()}
    shown = [family for family, header in headers.items() if header and header.is_photo]
    deep = {family: header for family, header in headers.items() if header and not header.is_photo}
    kinds: dict[Path, str] = {}
    if shown:
        for family, header in deep.items():
            kinds |= dict.fromkeys(families[family], f"of {header.bits} bits a channel")
    photos = {family: families[family] for family in shown}
    for parent in {family[0] for family in photos}:
        kinds |= _grey_ones({family: members for family, members in photos.items() if family[0] == parent})
    return kinds


def _grey_ones(families: Mapping[Family, Sequence[Path]]) -> dict[Path, str]:
    """Members of grey families of a folder whose numbers are all those of photos in colour."""
    if not 2 <= len(families) <= MOST_FAMILIES:
        return {}
    grey = {family for family, members in families.items() if _are_grey(members)}
    shown = {numbers for family in families.keys() - grey for numbers in _numbers(families[family])}
    beside = [family for family in grey if all(n and n in shown for n in _numbers(families[family]))]
    return {path: "grey beside colours" for family in beside for path in families[family]}


def _are_grey(paths: Sequence[Path]) -> bool:
    """Whether the first, the middle and the last image have equal channels; a single photo may be black."""
    for path in {paths[0], paths[len(paths) // 2], paths[-1]}:
        try:
            pixels = read_rgb8(path)
        except DataError:
            return False
        if (pixels != pixels[..., :1]).any():
            return False
    return True


def _header(path: Path) -> Header | None:
    try:
        return read_header(path)
    except (DataError, OSError):
        return None  # a broken file is reported when it is read


def _numbers(paths: Iterable[Path]) -> list[tuple[int, ...]]:
    return [tuple(int(digits) for digits in re.findall(r"\d+", path.stem)) for path in paths]

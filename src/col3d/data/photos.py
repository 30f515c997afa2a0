"""Which images of a folder are photos, and which are depth, normals, masks or the like beside them.

Names decide where they speak: `0001_depth.png`, `Depth_0001.png`, `mask01.png`. Where they do not, the type
of the pixels does: what has more than 8 bits a channel, or is grey beside colours of the same numbers.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from col3d.checks import DataError
from col3d.data.headers import Header, read_header

KINDS: Mapping[str, tuple[str, ...]] = {
    "depth": ("depth", "depths", "depthmap", "depthmaps", "disp", "disparity", "disparities", "zbuffer"),
    "normals": ("normals", "normalmap", "normalmaps"),
    "masks": ("mask", "masks", "seg", "segmentation", "segmentations", "label", "labels", "semantic"),
    "flow": ("flow", "flows", "opticalflow"),
    "occlusion": ("occlusion", "occlusions", "occ"),
    "coverage": ("coverage",),
    "truth": ("gt", "groundtruth"),
}
"""Words in names that say what a file is beside a photo."""
MAYBE = "normal"
"""Also what healthy tissue is called; it speaks of a photo of the same name alone."""
PHOTO_WORDS = (
    *("rgb", "color", "colour", "colors", "colours", "image", "images", "img", "imgs", "im"),
    *("frame", "frames", "framebuffer", "buffer", "photo", "photos", "left"),
)
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


@dataclass(frozen=True)
class Photos:
    """Files of a folder.

    Attributes:
        files: the photos, in their order.
        left_out: of each kind that is none, how many.
    """

    files: tuple[Path, ...]
    left_out: Mapping[str, int]

    def note(self, place: str) -> str:
        """What is left out, in a line; nothing where nothing is."""
        if not self.left_out:
            return ""
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(self.left_out.items()))
        return f"note: {place}: left out, for they are no photos: {listed}"


def choose_photos(paths: Sequence[Path]) -> Photos:
    """The photos among images; all of them where names and headers tell of none.

    Args:
        paths: in their order.
    """
    kinds = {path: kind_by_name(path.stem) for path in paths}
    plain = {_key(path.stem) for path, kind in kinds.items() if not kind and MAYBE not in _words(path.stem)}
    for path, kind in kinds.items():
        if not kind and MAYBE in _words(path.stem) and _key(path.stem) in plain:
            kinds[path] = "normals"
    kinds |= _kinds_by_type([path for path, kind in kinds.items() if not kind])
    files = tuple(path for path, kind in kinds.items() if not kind)
    return Photos(files, Counter(kind for kind in kinds.values() if kind))


def kind_by_name(stem: str) -> str:
    """Which of `KINDS` a name speaks of; nothing where of none."""
    words = set(_words(stem))
    return next((kind for kind, names in KINDS.items() if words & set(names)), "")


def is_photo_folder(name: str) -> bool:
    """Whether a folder is called as those of photos are."""
    return bool(set(_words(name)) & set(PHOTO_WORDS))


def _words(stem: str) -> list[str]:
    return [word.lower() for word in WORD.findall(stem)]


def _key(stem: str) -> str:
    """What is left of a name without the words for what it shows."""
    dull = {*PHOTO_WORDS, MAYBE}
    kept = WORD.sub(lambda match: "" if match[0].lower() in dull else match[0].lower(), stem)
    return re.sub(r"[^a-z0-9]+", " ", kept).strip()


def _kinds_by_type(paths: Sequence[Path]) -> dict[Path, str]:
    """What the pixels show to be no photos, by the first file of each family of names."""
    families: dict[tuple[str, str], list[Path]] = {}
    for path in paths:
        families.setdefault((re.sub(r"\d+", "#", path.stem), path.suffix), []).append(path)
    headers = {family: _header(members[0]) for family, members in families.items()}
    photos = [family for family, header in headers.items() if header is not None and header.is_photo]
    colours = [family for family in photos if _is_colour(headers[family])]
    shown = {numbers for family in colours for numbers in _numbers(families[family])}
    found: dict[Path, str] = {}
    for family, header in headers.items():
        if header is None or family in colours:
            continue
        members = families[family]
        if not header.is_photo and photos:
            found |= dict.fromkeys(members, f"of {header.bits} bits a channel")
        elif header.is_photo and all(numbers and numbers in shown for numbers in _numbers(members)):
            found |= dict.fromkeys(members, "grey beside colours")
    return found


def _header(path: Path) -> Header | None:
    try:
        return read_header(path)
    except (DataError, OSError):
        return None  # what is broken is said when it is read


def _is_colour(header: Header | None) -> bool:
    return header is not None and (header.colours >= 3 or header.is_palette)


def _numbers(paths: Iterable[Path]) -> list[tuple[int, ...]]:
    return [tuple(int(digits) for digits in re.findall(r"\d+", path.stem)) for path in paths]

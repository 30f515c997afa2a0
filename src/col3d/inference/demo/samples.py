"""Images to try the page with: frames of the phantom, rendered once."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from col3d.phantom import PhantomSettings, render_phantom

CAPTIONS = {
    "trans_t3_b": "with truth",
    "cecum_t2_a": "cecum",
    "desc_t4_a": "descending",
    "sigmoid_t3_b": "sigmoid",
}
"""Videos of the phantom, of which the second frame is offered."""
WITH_TRUTH = "trans_t3_b"
SETTINGS = PhantomSettings(size_hw=(540, 675), frames_per_video=2, videos=tuple(CAPTIONS))


@dataclass(frozen=True)
class Sample:
    """An image, its true depth where it is offered, and a caption."""

    image: Path
    truth: Path | None
    caption: str


def samples(cache: Path, folder: Path) -> list[Sample]:
    """The images, rendered below `cache` where they are not there yet, and copied into `folder`.

    Raises:
        DataError: the folder holds something else.
    """
    render_phantom(cache, SETTINGS, workers=1, progress=False)
    found = []
    for video, caption in CAPTIONS.items():
        image = Path(shutil.copy(cache / video / "0001_color.png", folder / f"{video}.png"))
        depth = cache / video / "0001_depth.tiff"
        truth = Path(shutil.copy(depth, folder / f"{video}_depth.tiff")) if video == WITH_TRUTH else None
        found.append(Sample(image, truth, caption))
    return found

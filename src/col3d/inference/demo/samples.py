"""Example images of the demo: frames of the phantom, rendered once."""

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
"""Videos of the phantom whose second frame is offered, with captions."""
WITH_TRUTH = "trans_t3_b"
SETTINGS = PhantomSettings(size_hw=(540, 675), frames_per_video=2, videos=tuple(CAPTIONS))


@dataclass(frozen=True)
class Sample:
    """An example image, its true depth if offered, and a caption."""

    image: Path
    truth: Path | None
    caption: str


def samples(cache: Path, folder: Path) -> list[Sample]:
    """Return the example images, rendered into `cache` if missing, and copied into `folder`.

    Raises:
        DataError: the cache holds something else.
    """
    render_phantom(cache, SETTINGS, workers=1, progress=False)
    images = []
    for video, caption in CAPTIONS.items():
        image = Path(shutil.copy(cache / video / "0001_color.png", folder / f"{video}.png"))
        depth = cache / video / "0001_depth.tiff"
        truth = Path(shutil.copy(depth, folder / f"{video}_depth.tiff")) if video == WITH_TRUTH else None
        images.append(Sample(image, truth, caption))
    return images

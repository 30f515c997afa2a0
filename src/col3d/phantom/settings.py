"""Settings of a phantom: size and number of frames, seed, and videos."""

import zlib
from dataclasses import dataclass, field

import numpy as np

from col3d.data.datasets.videos import seeded_name, video_table
from col3d.geometry import OmnidirectionalCamera
from col3d.nearest_names import check_known

PARTS = ("anatomy", "tissue", "light", "sensor")
"""Parts that can be randomised: the wall and the trajectory, its surface, the lamps, and the sensor."""


@dataclass(frozen=True)
class PhantomSettings:
    """Settings of a phantom data set; equal settings give equal bytes.

    Raises:
        ValueError: names the setting, the rule and the value.
    """

    size_hw: tuple[int, int] = (270, 338)
    """Height and width of the frames in pixels; C3VD's own are 1080 x 1350."""
    frames_per_video: int = 16
    """Number of frames along each trajectory; fewer frames make larger steps over the same length."""
    seed: int = 0
    """Seed of shapes, trajectories and textures, except for videos whose names contain their own seed."""
    randomise: tuple[str, ...] = ()
    """Parts that are drawn for every video; the others are those of its segment and texture. See `PARTS`."""
    videos: tuple[str, ...] = field(default_factory=lambda: tuple(video_table()))
    """Names of C3VD's videos to render; a name that ends in `_s` and a number uses that seed."""

    def __post_init__(self) -> None:
        if min(self.size_hw) < 16:
            raise ValueError(f"size_hw: expected at least 16 pixels a side, got {self.size_hw}")
        if self.frames_per_video < 1:
            raise ValueError(f"frames_per_video: expected at least 1, got {self.frames_per_video}")
        if self.seed < 0:
            raise ValueError(f"seed: expected 0 or more, got {self.seed}")
        for part in self.randomise:
            check_known("randomise", part, PARTS)
        for video in self.videos:
            check_known("videos", seeded_name(video, 0)[0], video_table())


def phantom_camera(settings: PhantomSettings) -> OmnidirectionalCamera:
    """Return C3VD's lens at the size of the phantom's frames."""
    return OmnidirectionalCamera.c3vd().resized(settings.size_hw)


def random_stream(seed: int, *names: str | int) -> np.random.Generator:
    """Make a random generator that depends only on the seed and the names, not on earlier draws."""
    return np.random.default_rng([seed, *(zlib.crc32(str(name).encode()) for name in names)])

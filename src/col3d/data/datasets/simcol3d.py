"""SimCol3D: rendered colonoscopies with depth, seen by a pinhole; normals are those of the depth.

References:
    Rau, Bano, Jin, Azagra, Morlana, Kader, Sanderson, ..., Stoyanov: SimCol3D, 3D Reconstruction during
    Colonoscopy Challenge, Medical Image Analysis 2024.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Shaped
from torch import Tensor

from col3d.data.datasets.dataset_index import check_root, named
from col3d.data.datasets.frame_files import Kind
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.geometry import Camera, PinholeCamera
from col3d.registry import register_dataset

TIMES, WIDTH, NEAR_MM, NEAR_PIXELS = 3, 21, 4.0, 7.0
"""Parameters of the bilateral filter. For depth in such steps it reduces the median error of normals from 46
to 4 degrees on a phantom, and to 0.4 degrees on a tube."""
MAX_DEPTH = 200.0
"""Millimetres that the code 255 * 256 stands for, the highest that the data set uses."""
FULL_CODE = 255 * 256
DEEPEST = 3
"""Levels below the root at which a video may lie."""


@register_dataset("simcol3d", split="simcol3d", label="SimCol3D")
class SimCol3D(FrameSet):
    """SimCol3D at 475 x 475, seen by a pinhole; it has no normals of its own. See `FrameSet`.

    A video is a folder of `FrameBuffer_NNNN.png` with `Depth_NNNN.png`, at most three levels below the root:
    `SyntheticColon_I/Frames_S1` is the video `Frames_S1`. Depth code 0 does not count.

    The codes hold 8 bits of depth, steps of 0.78 mm, of which normals cannot be derived: the steps would be
    terraces. They are smoothed by a bilateral filter first, for the normals alone.

    Args:
        root: folder of the folders of scenes.
        videos: names, or frame ranges such as `Frames_S1:0-120`.
        normals: `derived` from the depth, or `none`.
        camera: lens and size of the stored frames; the data set's own when absent.
    """

    kinds: Mapping[str, Kind] = {
        "color": Kind("FrameBuffer_{}.png", None, None),
        "depth": Kind("Depth_{}.png", 1, 16),
    }
    example = "FrameBuffer_NNNN.png with Depth_NNNN.png"
    max_depth = MAX_DEPTH
    dense_truth = True

    def __init__(
        self,
        root: str | Path,
        videos: Sequence[str],
        normals: str = "derived",
        camera: Camera | None = None,
    ) -> None:
        super().__init__(root, videos, camera or self.lens(), normals)

    @staticmethod
    def lens() -> Camera:
        """The camera of the data set at the size of its frames."""
        return PinholeCamera.from_focal((475, 475), 227.6, 227.6, 227.6, 237.5)

    @classmethod
    def video_folders(cls, root: Path) -> dict[str, Path]:
        """The folder of each video by its own name, at any level."""
        check_root(root)
        return named(sorted(_with_frames(root, DEEPEST)))

    def without_steps(self, depth: Tensor) -> Tensor:
        """Smooth depth (1, h, w) to derive normals from."""
        smooth = depth[0].numpy()
        for _ in range(TIMES):
            smooth = cv2.bilateralFilter(smooth, WIDTH, NEAR_MM, NEAR_PIXELS)
        return torch.from_numpy(smooth)[None]

    def decoded_depth(self, codes: Shaped[np.ndarray, "h w"]) -> Depth:
        """Decode depth, of all pixels or of some."""
        mm = codes.astype(np.float32) * np.float32(MAX_DEPTH / FULL_CODE)
        return Depth(mm, (codes > 0) & (codes <= FULL_CODE))


def _with_frames(folder: Path, levels: int) -> Iterator[Path]:
    """Folders below a folder that hold frames; the contents of such folders are not searched."""
    for path in folder.glob("*/"):  # only folders, without a look at every file
        if next(path.glob("FrameBuffer_*.png"), None):
            yield path
        elif levels > 1:
            yield from _with_frames(path, levels - 1)

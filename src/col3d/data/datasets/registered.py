"""Registration of this package's data sets that are not registered with their own class."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat

from col3d.data.datasets.c3vd import C3VD, Release
from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.data.datasets.folder import FolderFrames
from col3d.data.datasets.simcol3d import SimCol3D
from col3d.registry import register_dataset
from col3d.registry.schema import Options

__all__ = ["C3VD", "C3VDv2", "FolderFrames", "Phantom", "SimCol3D", "folder"]

PHANTOM_ROOT = (
    "data/phantom_${phantom.size.0}x${phantom.size.1}_${phantom.frames_per_video}_${phantom.seed}"
    "${drawn:${.randomise}}"
)


class LayoutOptions(Options):
    """How the files of `data=folder` are called and what they hold; see `col3d.data.datasets.folder`."""

    image: str = "{}.png"
    depth: str = "{}_depth.png"
    depth_unit: PositiveFloat
    max_depth: PositiveFloat = 100.0
    camera_file: str = "camera.json"
    depth_channel: Annotated[int, Field(ge=0)] | None = None
    depth_offset: int | None = None
    stamp_tolerance: PositiveFloat = 0.02


@register_dataset("folder")
def folder(root: Path, videos: Sequence[str], normals: str, layout: LayoutOptions) -> FolderFrames:
    """Your own frames: images with depth beside them, and a file that describes the camera."""
    return FolderFrames(root, videos, **layout.model_dump(), normals=normals)


@register_dataset("phantom", split="paper", normals="stored", rendered=True, root=PHANTOM_ROOT)
class Phantom(C3VD):
    """A colon rendered on the spot, in C3VD's format and with the names of its videos.

    Args:
        root: folder of the folders of videos.
        videos: names, labels of the paper, or frame ranges.
        rendered: has the `size` of the frames.
        normals: `stored`, `derived` or `none`.
        release: as of `C3VD`.
        randomise: what every video draws anew when it is rendered: all of it, or these parts.
    """

    def __init__(
        self,
        root: Path,
        videos: Sequence[str],
        rendered: Any,
        normals: str = "stored",
        release: Release = "current",
        randomise: bool | list[Literal["anatomy", "tissue", "light", "sensor"]] = False,
    ) -> None:
        height, width = rendered.size
        super().__init__(root, videos, release, normals, self.lens().resized((height, width)))

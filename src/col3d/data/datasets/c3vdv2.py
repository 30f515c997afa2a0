"""C3VDv2: the second part of C3VD, with videos of more kinds."""

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.octagon import octagon_mask
from col3d.geometry import Camera, OmnidirectionalCamera
from col3d.registry import register_dataset


@register_dataset(
    "c3vdv2",
    normals="stored",
    label="C3VDv2",
    table=True,
    view=octagon_mask,
    defaults={"release": "current"},
)
class C3VDv2(C3VD):
    """C3VDv2, seen by another lens: a folder for each video, in it one for each kind of file."""

    data = "c3vdv2"

    @staticmethod
    def lens() -> Camera:
        """The camera of the data set at the size of its frames."""
        return OmnidirectionalCamera.c3vdv2()

"""Metadata of exported files, with which they can be used without this code."""

from importlib.metadata import version
from typing import Any

from col3d.geometry.camera_file import plain_from_camera
from col3d.inference.export.traced import ANY, Fixed
from col3d.inference.predictor import Predictor
from col3d.layers.network import needs_rays, predicts

INPUTS = {
    "image": "float32 (batch, 3, height, width): RGB in [0, 1]; it is normalised, padded and cropped inside",
    "rays": "float32 (1, 3, height, width): the unit viewing ray of each pixel of the image",
}
OUTPUTS = {
    "depth": "float32 (batch, 1, height, width): millimetres along the optical axis",
    "normals": "float32 (batch, 3, height, width): unit vectors that face the camera",
}
CONVENTIONS = (
    "camera axes x right, y down, z forward; pixel centres at integers; millimetres hold for the lens of "
    "training, on images resized to trained_size"
)


def facts_of(predictor: Predictor, fixed: Fixed = ANY) -> dict[str, Any]:
    """Return name, sizes, range, lens, inputs, outputs and conventions as plain values for JSON."""
    given = ("image", "rays") if needs_rays(predictor.network) else ("image",)
    return {
        "model": predictor.name,
        "max_depth": predictor.max_depth,
        "trained_size": list(predictor.size_hw),
        "batch": fixed.batch,
        "size": None if fixed.size_hw is None else list(fixed.size_hw),
        "trained_on": list(predictor.trained_on),
        "lenses": [plain_from_camera(camera) for camera in predictor.cameras],
        "inputs": {name: INPUTS[name] for name in given},
        "outputs": {name: OUTPUTS[name] for name in predicts(predictor.network)},
        "conventions": CONVENTIONS,
        "col3d": version("col3d"),
        "torch": version("torch"),
    }

"""Comparison of an exported file with PyTorch, at several sizes, on noise and on a frame of a phantom."""

import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from col3d.data.files.images import read_image
from col3d.data.resize import resized_image
from col3d.errors import UserError
from col3d.inference.export.half_precision import HalfNetwork
from col3d.inference.export.traced import ANY, LEAST_SIDE, Fixed, sample
from col3d.inference.predictor import Predictor
from col3d.layers.network import predicts
from col3d.phantom import PhantomSettings, render_phantom

TOLERANCE = {"depth": 1e-5, "normals": 1e-4}
"""Largest allowed difference: of depth relative to the largest depth, of normals in each component."""
NOISE = ((1, LEAST_SIDE, 130), (3, 75, 101), (2, 224, 97))
"""Batches, heights and widths; the sides are no multiples of what networks pad to."""
ROUNDINGS = 2
"""Allowed error of a file in half precision, in multiples of the error of PyTorch's own half precision.

The file sums in another order, so that its error has the same size but not the same value; the two differ by
up to the sum of both."""
TURNS = 5


File = Callable[[Mapping[str, np.ndarray]], dict[str, np.ndarray]]
"""An opened exported file: a function from arrays by name to arrays by name."""


@dataclass(frozen=True)
class ParityReport:
    """Result of comparing an exported file with PyTorch.

    Attributes:
        sizes: batch, height and width of each comparison.
        differences: largest difference of each output, in mm and in a component of unit vectors.
        ratio: the file's time divided by PyTorch's, for one frame of the training's size.
        rounding: largest difference of PyTorch's own half precision from single, if it was measured.
    """

    sizes: Sequence[tuple[int, int, int]]
    differences: Mapping[str, float]
    ratio: float
    rounding: Mapping[str, float] = field(default_factory=dict)


def compare(
    predictor: Predictor, file: File, fixed: Fixed = ANY, half: HalfNetwork | None = None
) -> ParityReport:
    """Compare an exported file with its network in single precision.

    Args:
        predictor: predictor with the network.
        file: the opened file.
        fixed: batch and size that the file is bound to.
        half: the network in half precision, if the file is in half precision.

    Raises:
        UserError: they differ by more than is allowed.
    """
    differences = dict.fromkeys(predicts(predictor.network), 0.0)
    rounding = dict.fromkeys(predicts(predictor.network) if half else (), 0.0)
    sizes = []
    batch, height, width = fixed.shape(1, *predictor.size_hw)
    frame = phantom_frame((height, width)).expand(batch, -1, -1, -1).contiguous()
    for image in (*_noise(fixed), frame):
        inputs = sample(predictor.network, image, next(iter(predictor.cameras), None))
        rounded = {} if half is None else _differences(predictor, _as_file(half), inputs)
        current = _differences(predictor, file, inputs)
        _refuse(current, predictor.max_depth, rounded, tuple(image.shape))
        differences = {name: max(largest, current[name]) for name, largest in differences.items()}
        rounding = {name: max(largest, rounded[name]) for name, largest in rounding.items()}
        sizes.append((image.shape[0], image.shape[2], image.shape[3]))
    return ParityReport(list(dict.fromkeys(sizes)), differences, _ratio(predictor, file, frame), rounding)


def _noise(fixed: Fixed) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    shapes = [fixed.shape(*shape) for shape in NOISE]
    return [torch.rand(batch, 3, height, width, generator=generator) for batch, height, width in shapes]


def _as_file(network: HalfNetwork) -> File:
    """Wrap a network as if it were an opened file."""

    @torch.inference_mode()
    def run(inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        outputs = network(**{name: torch.from_numpy(values) for name, values in inputs.items()})
        return {name: values.numpy() for name, values in outputs.items()}

    return run


def phantom_frame(size_hw: tuple[int, int]) -> Tensor:
    """Render a frame of the phantom and resize it to an input of networks."""
    settings = PhantomSettings(frames_per_video=1, videos=("cecum_t1_a",))
    with tempfile.TemporaryDirectory() as folder:
        render_phantom(Path(folder), settings, workers=1, progress=False)
        pixels = read_image(Path(folder) / "cecum_t1_a" / "0000_color.png")
    image = torch.from_numpy(pixels.copy()).permute(2, 0, 1)[None]
    return resized_image(image, size_hw).float() / 255


@torch.inference_mode()
def _differences(predictor: Predictor, file: File, inputs: Mapping[str, Tensor]) -> dict[str, float]:
    expected = predictor.network(**inputs)
    outputs = file({name: values.numpy() for name, values in inputs.items()})
    names = predicts(predictor.network)
    return {name: float(np.abs(outputs[name] - expected[name].numpy()).max()) for name in names}


def _refuse(
    differences: Mapping[str, float], max_depth: float, rounded: Mapping[str, float], shape: tuple[int, ...]
) -> None:
    single = {"depth": TOLERANCE["depth"] * max_depth, "normals": TOLERANCE["normals"]}
    for name, difference in differences.items():
        if not math.isfinite(rounded.get(name, 0.0)):
            raise UserError(f"half: {name} that the network predicts in half precision is not finite")
        allowed = single[name] + ROUNDINGS * rounded.get(name, 0.0)
        if not difference <= allowed:  # so that NaN is refused
            raise UserError(
                f"export: {name} of {shape[0]} x {shape[2]} x {shape[3]} differs from PyTorch's by "
                f"{difference:.2g}, and {allowed:.2g} is allowed; nothing was written"
            )


@torch.inference_mode()
def _ratio(predictor: Predictor, file: File, frame: Tensor) -> float:
    inputs = sample(predictor.network, frame)
    arrays = {name: values.numpy() for name, values in inputs.items()}
    ways: list[Callable[[], object]] = [lambda: file(arrays), lambda: predictor.network(**inputs)]
    times: list[list[float]] = [[], []]
    for _ in range(TURNS):
        for way, taken in zip(ways, times, strict=True):
            start = time.perf_counter()
            way()
            taken.append(time.perf_counter() - start)
    return statistics.median(times[0]) / statistics.median(times[1])

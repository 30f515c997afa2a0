"""Published weights against the numbers of the published programs, in each precision."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import BFLOAT16, FLOAT16, FLOAT32, TF32, Mode, Setting, precision
from benchmarks.reference import network_input, published_numbers, published_state
from col3d.layers.network import DepthNetwork
from col3d.models.published import load_published

SOURCES = ("bts", "col3d_bts_cbam", "col3d_mtl_no_xtc", "col3d_mtl", "newcrfs", "monodepth_fpn")
TABLE = "Depth by published weights against the authors' numbers"
NORMALS = "Normals by published weights against the authors' numbers, float32"
NORMAL_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Tolerance:
    """What a mode may differ by: at most in mm at any pixel, or on average relative to the depth."""

    largest: float | None = None
    mean: float | None = None

    def __str__(self) -> str:
        return f"{self.largest:g} mm" if self.largest is not None else f"{self.mean:g} on average"

    def met(self, largest: float, mean: float) -> bool:
        """Whether a difference keeps to it."""
        return largest <= self.largest if self.largest is not None else mean <= (self.mean or 0)


TOLERANCES: dict[Mode, Tolerance] = {
    FLOAT32: Tolerance(largest=1e-3),
    TF32: Tolerance(mean=1e-3),
    BFLOAT16: Tolerance(mean=1e-2),
    FLOAT16: Tolerance(mean=1e-3),
}
"""float32 and bfloat16 as on CPUs. TF32 and float16 have 10 bits after the point: a thousandth of a value."""
COARSE_SOURCE = "monodepth_fpn"
COARSE = {FLOAT32: Tolerance(largest=1e-2)}
"""Of that network, whose reference is a fraction at a quarter of the size: 1e-4 of 100 mm, as on CPUs."""


@torch.no_grad()
def parity(setting: Setting, source: str) -> Iterator[Record]:
    """Differences of one network, in all modes.

    Raises:
        ArithmeticError: one is above its tolerance.
    """
    network = load_published(source, published_state(source)).to(setting.device)
    expected, missed = published_numbers(source), []
    truth = 100 * expected["depth_quarter"] if source == COARSE_SOURCE else expected["depth"]
    for mode in (FLOAT32, BFLOAT16) if setting.quick else TOLERANCES:
        with precision(mode, setting.device):
            depth, normals = outputs(network, source, setting.device)
        differences = (depth - truth).abs()
        largest, mean = float(differences.max()), float((differences / truth).mean())
        tolerance = _tolerance(source, mode)
        yield {
            "table": TABLE,
            "network": source,
            "precision": mode.name,
            "largest difference, mm": largest,
            "mean relative difference": mean,
            "tolerance": str(tolerance),
            "": tolerance.met(largest, mean),
        }
        if not tolerance.met(largest, mean):
            missed.append(mode.name)
        if mode is FLOAT32 and normals is not None:
            row = _normal_record(source, normals, expected["normal"])
            yield row
            missed += [] if row[""] else ["normals"]
    if missed:
        raise ArithmeticError(f"differences are above their tolerance: {', '.join(missed)}")


def outputs(network: DepthNetwork, source: str, device: torch.device) -> tuple[Tensor, Tensor | None]:
    """Depth in mm at the reference's size and normals on the CPU, in float32."""
    image = network_input().to(device)
    if source == COARSE_SOURCE:  # the reference is the decoder's fraction at a quarter of the size
        quarters: list[Tensor] = []
        decoder = network.get_submodule("depth_decoder")
        handle = decoder.register_forward_hook(lambda _, __, out: quarters.append(out))
        network.forward_normalised(image)
        handle.remove()
        return 100 * quarters[0].float().cpu(), None
    prediction = network.forward_normalised(image)
    normals = prediction.get("normals")
    return prediction["depth"].float().cpu(), None if normals is None else normals.float().cpu()


def _tolerance(source: str, mode: Mode) -> Tolerance:
    return COARSE.get(mode, TOLERANCES[mode]) if source == COARSE_SOURCE else TOLERANCES[mode]


def _normal_record(source: str, normals: Tensor, published: Tensor) -> Record:
    axes = published * torch.tensor([1.0, -1.0, -1.0])[:, None, None]
    largest = float((normals - axes / axes.norm(dim=1, keepdim=True)).abs().max())
    return {
        "table": NORMALS,
        "network": source,
        "largest difference of a component": largest,
        "tolerance": f"{NORMAL_TOLERANCE:g}",
        "": largest <= NORMAL_TOLERANCE,
    }

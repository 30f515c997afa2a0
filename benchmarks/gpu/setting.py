"""What is measured on, and in which precision."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch

MS = 1e3
NAMES = ("col3d_mtl", "newcrfs", "bts", "bts_cbam", "bts_cbam_mtl", "monodepth_fpn", "pix2pix")
"""Networks in the order of their worth."""


@dataclass(frozen=True)
class Mode:
    """A precision of the arithmetic.

    Attributes:
        name: of the mode.
        tf32: whether products of float32 may be taken in TF32.
        half: what autocast takes convolutions and products of matrices in, or None without autocast.
    """

    name: str
    tf32: bool
    half: torch.dtype | None = None


FLOAT32 = Mode("float32", tf32=False)
TF32 = Mode("TF32", tf32=True)
BFLOAT16 = Mode("bfloat16", tf32=True, half=torch.bfloat16)
FLOAT16 = Mode("float16", tf32=True, half=torch.float16)


@contextmanager
def precision(mode: Mode, device: torch.device) -> Iterator[None]:
    """Compute in a mode."""
    before = torch.backends.cuda.matmul.allow_tf32, torch.backends.cudnn.allow_tf32
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = mode.tf32
    try:
        with torch.autocast(device.type, mode.half, enabled=mode.half is not None):
            yield
    finally:
        torch.backends.cuda.matmul.allow_tf32, torch.backends.cudnn.allow_tf32 = before


@dataclass(frozen=True)
class Setting:
    """Device and sizes; the defaults are the paper's set-up.

    Attributes:
        device: that computes.
        quick: whether networks and images are the smallest, to show that all of it runs.
        side: height and width of images.
        batch: frames of a batch.
        rounds: that are counted.
        forwards: forward passes in a row that are timed as one, so that the host may run ahead.
        steps: training steps in a row, likewise.
        modes: precisions that are timed.
    """

    device: torch.device
    quick: bool = False
    side: int = 320
    batch: int = 8
    rounds: int = 5
    forwards: int = 3
    steps: int = 2
    modes: tuple[Mode, ...] = (FLOAT32, TF32, BFLOAT16)

    @property
    def overrides(self) -> list[str]:
        """Options of networks."""
        return ["model.width=64"] if self.quick else []

    @property
    def size(self) -> str:
        """For headings."""
        return f"{self.side} x {self.side}, batch of {self.batch}"


def smallest(device: torch.device) -> Setting:
    """A setting that only shows that all of it runs."""
    return Setting(device, True, side=64, batch=2, rounds=1, forwards=1, steps=1, modes=(FLOAT32,))

"""Time and memory of Col3D-MTL by size of images and batches, drawn: `python -m benchmarks.scaling`."""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import torch
from torch import nn

from benchmarks.memory import peak_bytes
from benchmarks.networks import batch_of, step
from benchmarks.timing import interleaved, spread_of
from col3d.models import create

SIDES = (128, 192, 256, 320, 448, 640)
BATCHES = (1, 2, 4)
LARGEST = 4 * 320**2
"""Pixels of a batch up to which it is measured; memory beyond is on a straight line."""
GB = 1e9
CARDS = (8, 16, 24)
KEPT_FREE = 1.5
"""GB that CUDA's context and the workspaces of convolutions take, which no count of tensors sees."""


class Point(NamedTuple):
    """One size.

    Attributes:
        side: of images, in pixels.
        batch: frames.
        seconds: of a training step.
        held: bytes at the most: weights, gradients, moments of AdamW, and all that a step keeps.
    """

    side: int
    batch: int
    seconds: float
    held: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print tables in Markdown and draw."""
    made = argparse.ArgumentParser("scaling", description=__doc__)
    made.add_argument("--sides", type=int, nargs="+", default=SIDES, help="multiples of 32")
    made.add_argument("--encoder", default="resnet50", help="timm model")
    made.add_argument("--width", type=int, default=512, help="of the decoders")
    made.add_argument("--repeats", type=int, default=2, help="steps that are counted")
    made.add_argument("--out", type=Path, default=Path("docs/scaling.png"), help="the drawing")
    options = made.parse_args(arguments)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = create("col3d_mtl", encoder=options.encoder, width=options.width).train().to(device)
    sizes = [(s, b) for s in options.sides for b in BATCHES if b == 1 or b * s**2 <= LARGEST]
    points = [measured(network, side, batch, device, options.repeats) for side, batch in sizes]
    print(*table(points), "", *fits(points, sorted(set(options.sides))), sep="\n")
    draw(points, options.out)
    print(f"wrote {options.out}")


def measured(network: nn.Module, side: int, batch: int, device: torch.device, repeats: int) -> Point:
    """A training step of one size."""
    work = partial(step, network, network.forward, batch_of(batch, side, device))
    seconds = interleaved({"step": work}, repeats, device)["step"]
    for parameter in network.parameters():
        parameter.grad = None
    weights = sum(p.numel() * p.element_size() for p in network.parameters())
    return Point(side, batch, spread_of(seconds).median, 3 * weights + peak_bytes(work, device))


def line_through(points: Sequence[Point]) -> tuple[float, float]:
    """Bytes without a frame, and bytes of a pixel: least squares."""
    pixels = torch.tensor([[1.0, p.batch * p.side**2] for p in points], dtype=torch.float64)
    held = torch.tensor([[p.held] for p in points], dtype=torch.float64)
    fixed, each = torch.linalg.lstsq(pixels, held).solution.flatten().tolist()
    return fixed, each


def table(points: Sequence[Point]) -> list[str]:
    """A row for each size."""
    lines = ["| side | batch | s a step | GB |", "|---|---|---|---|"]
    return lines + [f"| {p.side} | {p.batch} | {p.seconds:.2f} | {p.held / GB:.2f} |" for p in points]


def fits(points: Sequence[Point], sides: Sequence[int]) -> list[str]:
    """The largest batch for each card and side."""
    fixed, each = line_through(points)
    worst = max(abs(fixed + each * p.batch * p.side**2 - p.held) / p.held for p in points)
    lines = [
        f"{fixed / GB:.2f} GB and {each / 1e3:.2f} kB for each pixel of a batch; "
        f"no measured size is further from that than {100 * worst:.0f} %.",
        "",
        f"| side | {' | '.join(f'{card} GB' for card in CARDS)} |",
        f"|---|{'---|' * len(CARDS)}",
    ]
    for side in sides:
        largest = [int(((card - KEPT_FREE) * GB - fixed) // (each * side**2)) for card in CARDS]
        lines.append(f"| {side} | {' | '.join(str(max(0, batch)) for batch in largest)} |")
    return lines


def draw(points: Sequence[Point], path: Path) -> None:
    """Time and memory over the side, a line for each batch."""
    figure, (time, memory) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for batch in sorted({p.batch for p in points}):
        own = [p for p in points if p.batch == batch]
        sides = [p.side for p in own]
        time.plot(sides, [p.seconds for p in own], "o-", label=f"batch of {batch}")
        memory.plot(sides, [p.held / GB for p in own], "o-", label=f"batch of {batch}")
    for axes, label in ((time, "seconds a training step"), (memory, "GB at the most")):
        axes.set(xlabel="side of the images in pixels", ylabel=label, ylim=(0, None))
        axes.set_xticks(sorted({p.side for p in points}))
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()

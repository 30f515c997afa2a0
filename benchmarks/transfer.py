"""Networks on frames of a data set that they have not seen, beside what needs no network.

    python -m benchmarks.transfer /path/to/C3VD cecum_t1_a --checkpoint shipped

Prints a table in Markdown: errors of each after one factor for each frame, the ratio of the medians, and as
they are, with the least and the largest ratio of the medians as their scale. The three baselines know nothing
of the scene: a constant, light that falls with the square of the distance, and depth that falls with the
distance from the image's middle. They have no scale of their own.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from col3d.batch import Batch, Prediction
from col3d.data.datasets.c3vd import C3VD
from col3d.data.sized import Resized
from col3d.errors import DataError, UserError
from col3d.inference.predictor import load_predictor
from col3d.metrics.protocol import Protocol

SIZE = (128, 160)
DISPLAY_GAMMA = 2.2
SHOWN = ("abs_rel", "rmse", "delta1")
Guess = Callable[[Float[Tensor, "1 3 h w"]], Float[Tensor, "1 1 h w"]]
Guessed = tuple[Prediction, Batch]


def constant(image: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 1 h w"]:
    """The same depth everywhere."""
    return torch.ones_like(image[:, :1])


def by_light(image: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 1 h w"]:
    """Inverse square root of the linear brightness, as under one lamp at the lens."""
    linear = (image**DISPLAY_GAMMA).mean(dim=1, keepdim=True)
    return linear.clamp(min=1e-3) ** -0.5


def by_place(image: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 1 h w"]:
    """Falls linearly from the middle of the image to a tenth in its corners, as down a straight tube."""
    height, width = image.shape[2:]
    v, u = torch.meshgrid(torch.linspace(-1, 1, height), torch.linspace(-1, 1, width), indexing="ij")
    radius = (u * u * (width / height) ** 2 + v * v).sqrt()
    return (1 - 0.9 * radius / radius.max())[None, None]


BASELINES: Mapping[str, Guess] = {
    "constant": constant,
    "inverse square root of linear brightness": by_light,
    "falling with the distance from the middle": by_place,
}


def scores(said: Sequence[Guessed], scaling: str) -> dict[str, float]:
    """Means over frames."""
    protocol = Protocol(scaling=scaling)
    found = [protocol.score(prediction, batch) for prediction, batch in said]
    return {name: float(torch.stack([row[name] for row in found]).mean()) for name in SHOWN}


def scales(said: Sequence[Guessed]) -> list[float]:
    """For each frame the median of the guess over that of the truth, where there is truth."""
    pairs = [(prediction["depth"], batch["depth"], batch["mask"]) for prediction, batch in said]
    return [float(depth[mask].median() / truth[mask].median()) for depth, truth, mask in pairs]


def guessed(frames: Resized, guess: Guess) -> list[Guessed]:
    """What is guessed of each frame, before the frame as a batch of one."""
    said: list[Guessed] = []
    for index in range(len(frames)):
        item = frames[index]
        batch: Batch = {key: value[None] for key, value in item.items() if isinstance(value, Tensor)}  # type: ignore[assignment]
        said.append(({"depth": guess(batch["image"])}, batch))
    return said


def network(path: Path) -> Guess:
    """That of a checkpoint; it sees the frames as it did in training."""
    known = load_predictor(path)
    if known.size_hw != SIZE or known.network.needs_rays:
        raise UserError(f"{path}: expected a network of images alone at {SIZE}, got one at {known.size_hw}")

    @torch.inference_mode()
    def guess(image: Float[Tensor, "1 3 h w"]) -> Float[Tensor, "1 1 h w"]:
        return known.network(image, None)["depth"].float()

    return guess


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path, help="folder of the folders of videos, in C3VD's format")
    parser.add_argument("videos", nargs="+", help="names of videos, or frames of one such as cecum_t1_a:0-60")
    parser.add_argument(
        "--checkpoint", type=Path, action="append", default=[], help="of train.py, or shipped"
    )
    given = parser.parse_args()
    try:
        frames = Resized(C3VD(given.root, given.videos, normals="none"), SIZE)
        rows = {**BASELINES, **{str(path): network(path) for path in given.checkpoint}}
    except (DataError, UserError) as error:
        sys.exit(str(error))
    print(f"{len(frames)} frames of {', '.join(given.videos)}\n")
    print("| | abs_rel, median-scaled | delta1, median-scaled | abs_rel | rmse, mm | scale |")
    print("|---|---|---|---|---|---|")
    for name, guess in rows.items():
        said = guessed(frames, guess)
        scaled, plain = (scores(said, scaling) for scaling in ("median", "none"))
        own = "- | - | -"
        if name not in BASELINES:
            ratios = scales(said)
            own = f"{plain['abs_rel']:.3f} | {plain['rmse']:.1f} | {min(ratios):.2f} to {max(ratios):.2f}"
        print(f"| {name} | {scaled['abs_rel']:.3f} | {scaled['delta1']:.3f} | {own} |", flush=True)


if __name__ == "__main__":
    main()

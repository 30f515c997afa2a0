"""Colours that hold in every figure: of methods, of quantities, of normals."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap

from col3d.reports.paper_tables import LABELS

GREY = 0.8
FRAME_ASPECT = 1080 / 1350
"""Height by width of the frames; networks see them squeezed."""
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILLION, PURPLE, DARK = (
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
    "#666666",
)
OF_NETWORKS = {
    "pix2pix": ORANGE,
    "monodepth_fpn": PURPLE,
    "newcrfs": GREEN,
    "bts": BLUE,
    "bts_cbam": SKY,
    "bts_cbam_mtl": BLACK,
    "col3d_mtl": VERMILLION,
}
"""Okabe and Ito's colours, without yellow, which is lost on white."""
OTHERS = (BLACK, BLUE, ORANGE, GREEN, PURPLE, SKY, DARK)
Dash = Literal["-", "--", ":", "-."]
DASHES: tuple[Dash, ...] = ("-", "--", ":", "-.")


@dataclass(frozen=True)
class Style:
    """How the lines and points of a method look; variants of a network share its colour."""

    colour: str
    dash: Dash = "-"


@dataclass(frozen=True)
class Quantity:
    """What a map shows: its colours, what stands on its colour bar, and where values exceed that."""

    colours: str
    label: str
    extend: str

    @property
    def colormap(self) -> Colormap:
        """With grey for what does not count."""
        return colormaps[self.colours].with_extremes(bad=str(GREY))


QUANTITIES = {
    "depth": Quantity("viridis", "depth in mm", "both"),
    "error": Quantity("magma", "absolute error of depth in mm", "max"),
    "angle": Quantity("cividis", "angular error of normals in degrees", "max"),
}


def styles_of(labels: Iterable[str]) -> dict[str, Style]:
    """Style by label: a network's is fixed, runs of other options take what follows in their order."""
    known = {label: network_style(label) for label in labels}
    others = [label for label, style in known.items() if style is None]
    turns = {
        label: Style(OTHERS[n % len(OTHERS)], DASHES[n // len(OTHERS) % len(DASHES)])
        for n, label in enumerate(others)
    }
    return {label: style or turns[label] for label, style in known.items()}


def network_style(label: str) -> Style | None:
    """Of a label of the paper's tables; normals by L2 are dashed."""
    plain = label.removesuffix(" (L1)").removesuffix(" (L2)")
    models = {text: model for model, text in LABELS.items()}
    if plain not in models:
        return None
    return Style(OF_NETWORKS[models[plain]], "--" if label.endswith("(L2)") else "-")


def colours_of_normals(normals: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """X to red, -y to green, -z to blue, each from [-1, 1] to [0, 1]; grey where nothing counts."""
    colours = (normals * np.array([1.0, -1.0, -1.0]) + 1) / 2
    return np.where(mask[..., None], colours.clip(0, 1), GREY)


def ball(size: int = 120) -> np.ndarray:
    """RGBA (size, size, 4) of a ball that faces the camera in the colours of its normals: their key."""
    x, y = np.meshgrid(*2 * [np.linspace(-1.05, 1.05, size)])
    inside = x**2 + y**2 < 1
    normals = np.stack([x, y, -np.sqrt(np.where(inside, 1 - x**2 - y**2, 0.0))], axis=-1)
    return np.concatenate([colours_of_normals(normals, inside), inside[..., None]], axis=-1)

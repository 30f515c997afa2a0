"""Colours and dashes shared by all figures: of methods, of quantities, of normals."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap

from col3d.reports.colours import GREY, colours_of_normals

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
PALETTE = (BLACK, BLUE, ORANGE, GREEN, PURPLE, SKY, DARK, VERMILLION)
"""Okabe and Ito's colours, without yellow, which is lost on white."""
Dash = Literal["-", "--", ":", "-."]
DASHES: tuple[Dash, ...] = ("-", "--", ":", "-.")


@dataclass(frozen=True)
class Style:
    """Style of a method's lines and points; variants of a network share its colour."""

    colour: str
    dash: Dash = "-"


@dataclass(frozen=True)
class Quantity:
    """Style of a quantity's maps: colours, label of the colour bar, and its ends that values exceed."""

    colours: str
    label: str
    extend: str

    @property
    def colormap(self) -> Colormap:
        """The colour map, with grey for what does not count."""
        return colormaps[self.colours].with_extremes(bad=str(GREY))


QUANTITIES = {
    "depth": Quantity("viridis", "depth in mm", "both"),
    "error": Quantity("magma", "absolute error of depth in mm", "max"),
    "angle": Quantity("cividis", "angular error of normals in degrees", "max"),
}


@dataclass(frozen=True)
class Look:
    """What determines the style of a row.

    Attributes:
        network: name of its network.
        colour: colour from the network's registration, or "".
    """

    network: str
    colour: str


def styles_of(looks: Mapping[str, Look]) -> dict[str, Style]:
    """Styles by the labels of rows, in their order.

    Rows that are named for their network share its colour, normals by L2 with dashes, and the only row of a
    network has it under any name. Others take turns in a palette, and so do networks without a colour, which
    leave out the colours that are given.
    """
    alone = Counter(look.network for look in looks.values())
    keys = {
        label: look.network if _is_named(label, look) or alone[look.network] == 1 else label
        for label, look in looks.items()
    }
    given = {keys[label]: look.colour for label, look in looks.items() if look.colour}
    given = {key: colour for key, colour in given.items() if key in {look.network for look in looks.values()}}
    free = [colour for colour in PALETTE if colour not in given.values()] or list(PALETTE)
    others = dict.fromkeys(key for key in keys.values() if key not in given)
    turns = {
        key: Style(free[n % len(free)], DASHES[n // len(free) % len(DASHES)]) for n, key in enumerate(others)
    }
    styles = {**turns, **{key: Style(colour) for key, colour in given.items()}}
    return {
        label: replace(styles[key], dash="--") if label.endswith(" (L2)") else styles[key]
        for label, key in keys.items()
    }


def _is_named(label: str, look: Look) -> bool:
    return label.removesuffix(" (L1)").removesuffix(" (L2)") == look.network


def ball(size: int = 120) -> np.ndarray:
    """RGBA (size, size, 4) of a ball that faces the camera in the colours of its normals: their key."""
    x, y = np.meshgrid(*2 * [np.linspace(-1.05, 1.05, size)])
    inside = x**2 + y**2 < 1
    normals = np.stack([x, y, -np.sqrt(np.where(inside, 1 - x**2 - y**2, 0.0))], axis=-1)
    return np.concatenate([colours_of_normals(normals, inside), inside[..., None]], axis=-1)

"""The families of shapes that the parts of the colon have."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Segment:
    """The family of shapes of one part of the colon; lengths in mm, angles in radians."""

    length: float
    radius: float
    triangularity: float
    """Part of the radius by which the cross-section is triangular."""
    bend: float
    """Largest turn of the centreline off its mean direction."""
    bend_length: float
    """Length of one bend to both sides."""
    fold_spacing: float
    fold_height: float
    """Height of folds over the radius."""
    fold_reach: float
    """Half of the angle that a semi-lunar fold covers."""
    pouch: bool = False
    """Whether the blind end is the pouch of the cecum, with its three-armed fold and the orifice."""


SEGMENTS = {
    "cecum": Segment(
        length=150.0,
        radius=25.0,
        triangularity=0.04,
        bend=0.35,
        bend_length=220.0,
        fold_spacing=19.0,
        fold_height=0.36,
        fold_reach=1.9,
        pouch=True,
    ),
    "transverse": Segment(
        length=230.0,
        radius=20.0,
        triangularity=0.13,
        bend=0.4,
        bend_length=260.0,
        fold_spacing=17.0,
        fold_height=0.34,
        fold_reach=2.4,
    ),
    "descending": Segment(
        length=200.0,
        radius=14.0,
        triangularity=0.05,
        bend=0.55,
        bend_length=200.0,
        fold_spacing=15.0,
        fold_height=0.32,
        fold_reach=1.5,
    ),
    "sigmoid": Segment(
        length=230.0,
        radius=15.5,
        triangularity=0.06,
        bend=1.15,
        bend_length=170.0,
        fold_spacing=16.0,
        fold_height=0.4,
        fold_reach=1.7,
    ),
}

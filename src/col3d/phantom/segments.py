"""Families of shapes, one for each segment of the colon."""

from dataclasses import dataclass, replace

import numpy as np

TIGHTEST = 1.4
"""Least ratio of a bend's radius to the tube's; below 1 the inner side would intersect itself."""


@dataclass(frozen=True)
class Segment:
    """The family of shapes of one segment of the colon; lengths in mm, angles in radians."""

    length: float
    radius: float
    lobe: float
    """Amplitude of the cross-section's lobes, relative to the radius."""
    bend: float
    """Largest angle between the centreline and its mean direction."""
    bend_length: float
    """Length of one bend to both sides."""
    fold_spacing: float
    fold_height: float
    """Height of folds relative to the radius."""
    fold_reach: float
    """Half of the angle that a semi-lunar fold covers."""
    pouch: bool = False
    """Whether the blind end is the pouch of the cecum, with its armed fold and the orifice."""
    lobes: int = 3
    """Number of lobes of the cross-section and of arms of the pouch's fold; three as a colon has bands."""
    swing: float = 0.07
    """Variation of the calibre along the tube, relative to the radius."""
    wrinkle: float = 0.0
    """Height in mm of the fine rings between folds."""
    arm: float = 3.2
    """Height in mm of the arms of the pouch's fold."""
    arm_sharpness: int = 6
    flatness: float = 0.75
    """Length of the closed ends relative to their radius."""
    fold_width: float = 2.45
    """Mean standard deviation in mm of a fold's profile along the tube."""
    swell: float = 1.3
    """Height in mm of the soft unevenness of the wall."""
    swell_size: float = 14.0

    def varied(self, random: np.random.Generator) -> "Segment":
        """Draw a variant of the family: calibre, cross-section, bends, folds, rings and ends."""
        drawn = replace(
            self,
            length=self.length * random.uniform(0.8, 1.2),
            radius=self.radius * float(np.exp(random.uniform(-0.3, 0.3))),
            lobe=random.uniform(0.0, 0.16),
            lobes=int(random.choice([2, 3, 3, 3, 3, 4])),
            bend=self.bend * random.uniform(0.2, 1.4),
            fold_spacing=self.fold_spacing * float(np.exp(random.uniform(-0.4, 0.7))),
            fold_height=self.fold_height * random.uniform(0.25, 1.3),
            fold_reach=random.uniform(1.3, 3.6),
            swing=random.uniform(0.03, 0.22),
            wrinkle=random.uniform(0.0, 0.5) * float(random.random() < 0.6),
            arm=random.uniform(1.5, 7.0),
            arm_sharpness=int(random.choice([2, 4, 6, 8])),
            flatness=random.uniform(0.35, 1.1),
            fold_width=self.fold_width * float(np.exp(random.uniform(-0.4, 0.5))),
            swell=random.uniform(0.4, 2.2),
            swell_size=self.swell_size * float(np.exp(random.uniform(-0.4, 0.4))),
        )
        sharpest = drawn.bend_length / (2 * np.pi * TIGHTEST * drawn.radius)
        return replace(drawn, bend=min(drawn.bend, sharpest))


SEGMENTS = {
    "cecum": Segment(
        length=150.0,
        radius=25.0,
        lobe=0.04,
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
        lobe=0.13,
        bend=0.4,
        bend_length=260.0,
        fold_spacing=17.0,
        fold_height=0.34,
        fold_reach=2.4,
    ),
    "descending": Segment(
        length=200.0,
        radius=14.0,
        lobe=0.05,
        bend=0.55,
        bend_length=200.0,
        fold_spacing=15.0,
        fold_height=0.32,
        fold_reach=1.5,
    ),
    "sigmoid": Segment(
        length=230.0,
        radius=15.5,
        lobe=0.06,
        bend=1.15,
        bend_length=170.0,
        fold_spacing=16.0,
        fold_height=0.4,
        fold_reach=1.7,
    ),
}

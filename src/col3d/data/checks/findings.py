"""Results of a verification: findings, and reports of frames and videos."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32

NAN = float("nan")


@dataclass(frozen=True)
class Finding:
    """A fault or a note on the data.

    Attributes:
        rule: name of the rule, such as `pair` or `unit length`.
        text: a line that names the file, the rule and what was found.
        video: empty where it is about the whole data set.
        frame: None where it is about a whole video.
        fault: whether something is wrong; otherwise it is a note.
    """

    rule: str
    text: str
    video: str = ""
    frame: int | None = None
    fault: bool = True


@dataclass(frozen=True)
class Reprojection:
    """Depth of one frame compared with that of another, seen through their poses.

    Attributes:
        to: number of the other frame.
        step: mm from the one camera to the other.
        seen: share of the points that the other frame sees too.
        median: median of the absolute differences of depth in mm; NaN where the two hardly see the same.
        tenth: the difference that a tenth of the points stays below.
    """

    to: int
    step: float
    seen: float
    median: float
    tenth: float


@dataclass
class FrameReport:
    """Results of the checks of one frame; NaN where something was not checked.

    Attributes:
        in_full: whether its files were decoded, not only their headers read.
        low: least depth in mm.
        high: largest depth in mm.
        unknown: share of the pixels whose depth does not count, by its code.
        outside: share of the pixels with depth that lie outside the octagon.
        digest: SHA-1 of the decoded picture; empty where it could not be decoded.
        angles: median angle in degrees of the stored normals to those of the depth, by convention.
        off_length: share of the stored normals without unit length, by encoding.
        flow: median distance in pixels of stored flow from the motion that depth and poses imply.
    """

    video: str
    number: int
    in_full: bool = False
    low: float = NAN
    high: float = NAN
    unknown: float = NAN
    outside: float = NAN
    digest: str = ""
    angles: Float32[np.ndarray, " c"] | None = None
    off_length: tuple[float, ...] = ()
    reprojection: Reprojection | None = None
    flow: float = NAN
    findings: list[Finding] = field(default_factory=list)

    def fault(self, rule: str, text: str) -> None:
        """Add a fault of the frame."""
        self.findings.append(Finding(rule, text, self.video, self.number))


@dataclass
class VideoReport:
    """Results of the checks of one video: medians and means over its frames.

    Attributes:
        frames: number of frames that exist.
        expected: number of frames that should exist; None where it is not known.
        in_full: number of frames that were decoded.
        size: height and width that all frames have to have.
        release: release of the data set that it follows; empty where there are none.
        normals: convention of its stored normals; empty without any.
        camera: `lens` or `pinhole`, the camera of the depth's normals that fit them.
        angle: median angle in degrees between the two.
        ranking: the best conventions with their angles.
        off_length: share of the normals without unit length.
        pairs: number of pairs of frames whose depth was compared.
        poses: whether pose.txt exists.
        reprojection: median over the pairs in mm.
        lens: by reading of the lens, the median over pairs of frames farther apart of the median
            |z - depth there| in mm; the first is the camera's own. See `lens.check_lens`.
        lens_pairs: number of those pairs.
        flow: median over frames of the median distance in pixels of stored flow from the motion that depth
            and poses imply.
        duplicates: number of frames with the picture of another.
    """

    video: str
    folder: str
    size: tuple[int, int]
    frames: int = 0
    expected: int | None = None
    in_full: int = 0
    low: float = NAN
    high: float = NAN
    unknown: float = NAN
    outside: float = NAN
    release: str = ""
    normals: str = ""
    camera: str = ""
    angle: float = NAN
    ranking: list[tuple[str, float]] = field(default_factory=list)
    off_length: float = NAN
    poses: bool = False
    pairs: int = 0
    reprojection: float = NAN
    worst_reprojection: float = NAN
    lens: dict[str, float] = field(default_factory=dict)
    lens_pairs: int = 0
    flow: float = NAN
    duplicates: int = 0
    findings: list[Finding] = field(default_factory=list)

    def fault(self, rule: str, text: str, frame: int | None = None) -> None:
        """Add a fault of the video, or of one of its frames."""
        self.findings.append(Finding(rule, text, self.video, frame))

    def note(self, rule: str, text: str) -> None:
        """Add a note on the video."""
        self.findings.append(Finding(rule, text, self.video, fault=False))

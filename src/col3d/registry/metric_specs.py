"""Specifications of metrics: task, unit, direction, headings, and how each is averaged.

Nothing here computes anything, so that reports, which do not import torch, share this table with the scorer.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from col3d.nearest_names import check_known

TASKS = ("depth", "normals")
DIRECTIONS = ("lower", "higher", None)
OVER_PIXELS = ("mean", "root", None)
COUNTS = ("pixels", "normal_pixels")
"""Columns of a score beside the metrics: the number of pixels that it counted."""
RESERVED = (
    *("model", "seed", "data", "split", "video", "segment", "texture", "frame", "protocol"),
    *(*COUNTS, "frames", "epoch", "step"),
)
"""Names of other columns and entries in the files that hold metrics."""


@dataclass(frozen=True)
class MetricSpec:
    """Specification of a metric for files, tables and figures; the defaults suit a plugin's metric.

    Attributes:
        name: name of the metric in `per_frame.csv`, `metrics.csv` (`val/<name>`) and `summary.json`.
        task: what it is measured on, "depth" or "normals"; "" if unknown.
        better: "lower", "higher", or None if neither is better; then no row of a table is best.
        unit: unit of the printed value, after `scale`.
        heading: heading in tables and figures; if empty, the name.
        latex: heading in LaTeX; if empty, `heading`.
        decimals: digits after the point in tables.
        scale: factor for values in tables: 100 for shares in percent.
        over_pixels: how `average=pixel` averages the values of frames: "mean" weights each by its pixels,
            "root" does so with its square, None leaves the metric out because it is no mean over pixels.
        in_validation: whether it is measured after every epoch of a training, as `val/<name>`.
        undefined: whether NaN means that a frame has no value and is not counted; otherwise NaN is an error
            of the prediction and is kept.
        short: heading on screen, with the unit; values on screen are not scaled.
        short_decimals: digits after the point on screen.
        on_screen: whether it is in the table that a run prints.
        by_video: whether it is in tables by video.
        further: whether it is in the table of further metrics instead of the main one.
        on_request: whether it is measured only under protocols that name it.
    """

    name: str
    task: str = "depth"
    better: str | None = None
    unit: str = ""
    heading: str = ""
    latex: str = ""
    decimals: int = 3
    scale: float = 1.0
    over_pixels: str | None = "mean"
    in_validation: bool = True
    undefined: bool = True
    short: str = ""
    short_decimals: int | None = None
    on_screen: bool = True
    by_video: bool = True
    further: bool = False
    on_request: bool = False

    @property
    def title(self) -> str:
        """Heading in tables and figures."""
        return self.heading or self.name

    @property
    def screen_title(self) -> str:
        """Heading on screen."""
        unit = self.unit if self.scale == 1 and self.unit not in self.title else ""
        return self.short or f"{self.title} {unit}".strip()

    @property
    def screen_decimals(self) -> int:
        """Digits after the point on screen."""
        return self.decimals if self.short_decimals is None else self.short_decimals

    def plain(self) -> dict[str, Any]:
        """Return the fields that differ from their defaults, as plain values for JSON."""
        usual = MetricSpec(self.name)
        return {key: value for key, value in asdict(self).items() if value != getattr(usual, key)}


def checked_spec(spec: MetricSpec) -> MetricSpec:
    """Return a spec after checking that files and tables can hold it.

    Raises:
        ValueError: names the field that breaks a rule.
    """
    where = f"register_metric: {spec.name}"
    if spec.name in RESERVED or spec.name == "loss" or spec.name.startswith("loss_"):
        raise ValueError(f"{where} is the name of another column; give the metric another one")
    if OURS.get(spec.name, spec) is not spec:
        raise ValueError(f"{where} is a metric of col3d; give yours another name")
    for argument, known in (("task", TASKS), ("better", DIRECTIONS), ("over_pixels", OVER_PIXELS)):
        value = getattr(spec, argument)
        if value not in known:
            check_known(f"{where}: {argument}", str(value), map(str, known))
    for argument in ("unit", "heading", "latex", "short"):
        if not getattr(spec, argument).isprintable():
            raise ValueError(f"{where}: {argument}: expected one line, got {getattr(spec, argument)!r}")
    if not 0 <= spec.decimals <= 12:
        raise ValueError(f"{where}: decimals: expected 0 to 12, got {spec.decimals}")
    return spec


def specs_from(recorded: Mapping[str, Mapping[str, Any]]) -> dict[str, MetricSpec]:
    """Read specs as `summary.json` holds them; unknown fields, of later versions, are ignored."""
    known = {field.name for field in fields(MetricSpec)} - {"name"}
    return {
        name: MetricSpec(name, **{key: value for key, value in values.items() if key in known})
        for name, values in recorded.items()
    }


def by_name(specs: Iterable[MetricSpec]) -> dict[str, MetricSpec]:
    """Return specs as a dict by name, in their order."""
    return {spec.name: spec for spec in specs}


def unknown(name: str) -> MetricSpec:
    """Return the spec of a column without one: only its name is known, and no value is best."""
    return MetricSpec(name, task="", over_pixels=None)


def _ours(name: str, better: str, **fields_set: Any) -> MetricSpec:
    """Build the spec of a metric that every frame has, and that is not in tables by video by default."""
    return MetricSpec(name, better=better, **{"undefined": False, "by_video": False, **fields_set})


def _share(name: str, limit: str, **fields_set: Any) -> MetricSpec:
    """Build the spec of the share of pixels whose angle is below a limit, in percent."""
    latex = rf"$\delta_{{{limit}^\circ}}$"
    words = {"heading": f"< {limit}°", "latex": latex, "short": f"< {limit} deg"}
    return _ours(name, "higher", task="normals", scale=100.0, unit="%", **words, **fields_set)


def _angle(name: str, heading: str, short: str, **fields_set: Any) -> MetricSpec:
    words = {"heading": heading, "latex": heading, "short": short, "short_decimals": 2}
    return _ours(name, "lower", task="normals", unit="°", **words, **fields_set)


FURTHER: dict[str, Any] = {"further": True, "on_screen": False}
PARTIAL: dict[str, Any] = {**FURTHER, "undefined": True, "over_pixels": None, "in_validation": False}
"""Fields of metrics that some frames have no value of, and that are no means over all pixels of a frame."""
RMSE_LOG = r"RMSE$_{\log}$"
PAPER_DEPTH = (
    _ours("abs_rel", "lower", heading="Abs Rel", latex="Abs Rel", short="AbsRel", by_video=True),
    _ours("sq_rel", "lower", unit="mm", heading="Sq Rel", latex="Sq Rel", short="SqRel mm"),
    _ours("log10", "lower", latex=r"$\log_{10}$"),
    _ours(
        "rmse",
        "lower",
        unit="mm",
        heading="RMSE",
        latex="RMSE",
        over_pixels="root",
        short_decimals=2,
        by_video=True,
    ),
    _ours("rmse_log", "lower", heading="RMSE log", latex=RMSE_LOG, over_pixels="root", short="RMSElog"),
    _ours("silog", "lower", unit="%", heading="SILog", latex="SILog", short_decimals=2, by_video=True),
    _ours("delta1", "higher", heading="δ1", latex=r"$\delta_1$", short="d1", by_video=True),
    _ours("delta2", "higher", heading="δ2", latex=r"$\delta_2$", short="d2"),
    _ours("delta3", "higher", heading="δ3", latex=r"$\delta_3$", short="d3"),
)
PAPER_NORMALS = (
    _angle("angle_mean", "Mean Ang", "mean deg", by_video=True),
    _angle("angle_median", "Median Ang", "median deg"),
    _share("within_11_25", "11.25"),
    _share("within_22_5", "22.5"),
    _share("within_30", "30"),
)
"""The metrics of the Col3D-MTL paper, in its order: normals here, depth above."""
DELTA_1_1 = _ours("delta_1_1", "higher", heading="δ < 1.1", latex=r"$\delta_{1.1}$", on_screen=False)
MAE = _ours("mae", "lower", unit="mm", heading="MAE", latex="MAE", **FURTHER)
RANGES = {"near": (0.0, 30.0), "mid": (30.0, 70.0), "far": (70.0, float("inf"))}
"""Ranges of ground-truth depth in mm: the first bound is included, the second is not."""
IN_WORDS = {"near": "< 30 mm", "mid": "30 to 70 mm", "far": "≥ 70 mm"}
IN_LATEX = {"near": r"$<30$", "mid": r"$30..70$", "far": r"$\geq70$"}


def _in_range(spec: MetricSpec, part: str) -> MetricSpec:
    """Build the spec of a metric over the pixels whose ground-truth depth is in a range."""
    return MetricSpec(
        f"{part}_{spec.name}",
        better=spec.better,
        unit=spec.unit,
        heading=f"{spec.title}, {IN_WORDS[part]}",
        latex=f"{spec.latex}, {IN_LATEX[part]} mm",
        by_video=False,
        **PARTIAL,
    )


OF_RANGES = tuple(spec for spec in (*PAPER_DEPTH, MAE) if spec.name in ("abs_rel", "rmse", "mae", "delta1"))
DEPTH_RANGES = tuple(_in_range(spec, part) for part in RANGES for spec in OF_RANGES)
FURTHER_NORMALS = (
    _angle("angle_rmse", "RMS Ang", "rms deg", over_pixels="root", **FURTHER),
    _share("within_5", "5", **FURTHER),
    _share("within_7_5", "7.5", **FURTHER),
)
BOUNDARY_F1 = MetricSpec(
    "boundary_f1", better="higher", heading="Boundary F1", latex="Boundary F1", by_video=False, **PARTIAL
)
ON_REQUEST: dict[str, Any] = {"on_request": True, "in_validation": False, "over_pixels": None}
LITERATURE = (
    _ours("silog_half", "lower", heading="SILog, λ = 0.5", latex=r"SILog$_{0.5}$", **ON_REQUEST),
    _ours("within_10_percent", "higher", heading="Abs Rel < 0.1", latex=r"Abs Rel $<0.1$", **ON_REQUEST),
    _ours("l1_cm", "lower", heading="L1", latex="L1", unit="cm", **ON_REQUEST),
    _ours("median_rel", "lower", heading="Median Rel", latex="Median Rel", unit="%", **ON_REQUEST),
    _ours("rmse_cm", "lower", heading="RMSE", latex="RMSE", unit="cm", **ON_REQUEST),
)
"""Specs of metrics of other papers' programs, which only their protocols measure."""
OURS = by_name((*PAPER_DEPTH, *PAPER_NORMALS, DELTA_1_1, MAE, *DEPTH_RANGES, *FURTHER_NORMALS, BOUNDARY_F1))
"""Specs of this package's metrics by name, in the order of their columns."""

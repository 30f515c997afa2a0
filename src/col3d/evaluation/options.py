"""Options of `col3d evaluate`, and of the protocols that predictions are scored under."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, model_validator

from col3d.data.options import Data, Size, Split
from col3d.metrics.alignment import FITS, IN_WORDS
from col3d.metrics.options import MetricOptions
from col3d.models.published.options import Published
from col3d.nearest_names import check_known
from col3d.phantom.options import PhantomOptions
from col3d.registry import METRICS
from col3d.registry.fields import Accelerator, NonNegative
from col3d.registry.schema import NoneWord, Options

ALL = 1e6
"""Upper bound of the true depth in mm from which a protocol counts all of it: a kilometre."""
LEAST = 1e-6
"""Lower bound in mm up to which tables say 0."""
SIZES = {"network": "the network's size", "native": "its own size"}
TRUTHS = {
    "clean": "without unknown pixels mixed in",
    "mixed": "with unknown pixels mixed in",
    "area": "averaged over areas",
}


def _fit(name: str) -> str:
    return check_known("protocol.scaling", name, FITS)


def _metrics(names: list[str] | None) -> list[str] | None:
    for name in names or ():
        METRICS[name]  # refuses a name that is unknown
    return names


class ProtocolOptions(Options):
    """How predictions are scored; its name stands in every table."""

    mirror: Annotated[Literal["mean", "ramp"] | None, NoneWord]
    resolution: Literal["network", "native"]
    truth: Literal["clean", "mixed", "area"]
    truth_range: Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
    positive: bool = False
    clip: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] | None = None
    scaling: Annotated[str, AfterValidator(_fit)]
    scaling_of: Literal["depth", "inverse_depth"] = "depth"
    scaling_over: Literal["frame", "video"] = "frame"
    epsilon: NonNegative = 0.0
    cosine_epsilon: NonNegative
    normal_axes: Literal["standard", "published"]
    metrics: Annotated[list[str] | None, AfterValidator(_metrics)] = None
    metric_options: MetricOptions
    average: Literal["frame", "video", "pixel"]

    @property
    def has_own_truth(self) -> bool:
        """Whether predictions are compared with other frames than those they are made from."""
        return self.resolution == "native" or self.truth != "clean"

    @property
    def keeps_panels(self) -> bool:
        """Whether the frames that are compared can be drawn: those of the network's size, one by one."""
        return self.resolution == "network" and self.scaling_over == "frame"

    def in_words(self) -> dict[str, str]:
        """What every table says of a protocol: the mask, the alignment, the truth and the average."""
        low, high = self.truth_range
        bounds = f"within {low:g} and {high:g}" if high < ALL else f"above {low if low > LEAST else 0:g}"
        known = f"true depth {bounds} mm"
        fit = IN_WORDS[self.scaling].format(of="" if self.scaling_of == "depth" else " of inverse depth")
        if self.scaling != "none":
            fit = f"{fit}, for each {self.scaling_over}"
        return {
            "mask": f"{known}, predictions above 0" if self.positive else known,
            "alignment": fit,
            "truth": f"{TRUTHS[self.truth]}, at {SIZES[self.resolution]}",
            "average": f"each {self.average} alike",
        }

    @model_validator(mode="after")
    def _has_ranges(self) -> "ProtocolOptions":
        for name in ("truth_range", "clip"):
            limits = getattr(self, name)
            if limits is not None and limits[0] >= limits[1]:
                raise ValueError(f"protocol.{name}: expected [low,high] with low below high, got {limits}")
        return self


Protocols = Annotated[dict[str, ProtocolOptions], Field(min_length=1)]
"""Options of protocols by name: `protocol=standard`, or `protocol=[standard,published]` for several."""


class ReadingOptions(Options):
    """How files of predictions are named, and what their numbers mean."""

    name: str | None = None
    depth: str | None = None
    normals: str | None = None
    holds: Literal["depth", "inverse_depth"] = "depth"
    unit: PositiveFloat | None = 1.0
    axes: Literal["standard", "opengl"] = "standard"
    order: Literal["number", "position"] = "number"

    @model_validator(mode="after")
    def _are_numbered(self) -> "ReadingOptions":
        for kind in ("depth", "normals"):
            name = getattr(self, kind)
            if name is not None and name.count("{}") != 1:
                raise ValueError(
                    f"reading.{kind}: expected {{}} once, in the place of a frame's number, got {name!r}"
                )
        return self


class EvaluateOptions(Options):
    """Everything that `col3d evaluate` takes; what is null stays as the checkpoint was trained.

    `data` and `phantom` may be left out; `published` names the program whose weights the checkpoint holds.
    `predictions`, a folder of what another program predicted, is scored in the place of a checkpoint.
    """

    checkpoint: str | None
    predictions: str | None
    reading: ReadingOptions
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None
    protocol: Protocols
    data: Data | None = None
    phantom: PhantomOptions
    output_dir: str | None
    split: Split
    panels: Annotated[int, Field(ge=0)]
    keep_predictions: bool
    root: str | None
    batch_size: PositiveInt | None
    workers: Annotated[int, Field(ge=0)] | None
    accelerator: Accelerator
    compile: bool
    metrics: MetricOptions

    @property
    def weights(self) -> Path:
        """The checkpoint's path."""
        assert self.checkpoint is not None, "predictions are scored without one"
        return Path(self.checkpoint)

    @model_validator(mode="after")
    def _fits(self) -> "EvaluateOptions":
        if (self.checkpoint is None) == (self.predictions is None):
            raise ValueError(
                "checkpoint: a value is needed; give checkpoint=PATH, or predictions=FOLDER instead"
            )
        if self.predictions is not None:
            self._files_fit()
        if self.max_depth is not None and self.published is None:
            raise ValueError("max_depth: only for published weights; our checkpoints store it")
        if self.data is not None:
            self.data.split.needs("data.split", self.split)
            if self.data.test or self.data.also:
                raise ValueError("data.test, data.also: are of trainings; col3d evaluate scores on data=...")
        return self

    def _files_fit(self) -> None:
        """Refuse options that need a network, and predictions without a unit whose scale nothing fits."""
        if self.data is None:
            raise ValueError("data: predictions do not say what to score them on; take data=c3vd or another")
        network = {"published": self.published, "max_depth": self.max_depth}
        network |= {"compile": self.compile, "keep_predictions": self.keep_predictions}
        for name, value in network.items():
            if value:
                raise ValueError(f"{name}: is of a network, and predictions={self.predictions} has none")
        for name, protocol in self.protocol.items():
            if protocol.mirror is not None:
                raise ValueError(
                    f"protocol: {name} predicts mirrored frames, for which it needs a checkpoint"
                )
            if self.reading.unit is None and protocol.scaling == "none":
                raise ValueError(
                    f"reading.unit: null is for depth up to scale, and protocol {name} fits none; take "
                    "protocol=median_scaled, scale_and_shift or another that does"
                )

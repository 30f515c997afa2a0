"""Options of `col3d evaluate`, and of the protocols that predictions are scored under."""

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from col3d.data.options import Data, Size, Split
from col3d.metrics import Protocol
from col3d.metrics.options import MetricOptions
from col3d.models.published.options import Published
from col3d.phantom.options import PhantomOptions
from col3d.registry.fields import Accelerator, NonNegative
from col3d.registry.schema import NoneWord, Options


class ProtocolOptions(Options):
    """How predictions are scored; its name stands in every table."""

    mirror: Annotated[Literal["mean", "ramp"] | None, NoneWord]
    resolution: Literal["network", "native"]
    truth: Literal["clean", "mixed"]
    truth_range: Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
    scaling: Literal["none", "median", "scale_and_shift"]
    cosine_epsilon: NonNegative
    normal_axes: Literal["standard", "published"]
    average: Literal["frame", "video", "pixel"]

    @property
    def has_own_truth(self) -> bool:
        """Whether predictions are compared with other frames than those they are made from."""
        return self.resolution == "native" or self.truth == "mixed"

    @model_validator(mode="after")
    def _has_a_range(self) -> "ProtocolOptions":
        if self.truth_range[0] >= self.truth_range[1]:
            raise ValueError(
                f"protocol.truth_range: expected [low,high] with low below high, got {self.truth_range}"
            )
        return self


def build_protocol(name: str, options: ProtocolOptions, metrics: MetricOptions) -> Protocol:
    """Build the protocol of its options; `metrics` are options of metrics by name."""
    low, high = options.truth_range
    return Protocol(
        name, options.scaling, (low, high), options.cosine_epsilon, options.normal_axes, metrics=metrics
    )


Protocols = Annotated[dict[str, ProtocolOptions], Field(min_length=1)]
"""Options of protocols by name: `protocol=standard`, or `protocol=[standard,published]` for several."""


class EvaluateOptions(Options):
    """Everything that `col3d evaluate` takes; what is null stays as the checkpoint was trained.

    `data` and `phantom` may be left out; `published` names the program whose weights the checkpoint holds.
    """

    checkpoint: str
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None
    protocol: Protocols
    data: Data | None = None
    phantom: PhantomOptions
    output_dir: str | None
    split: Split
    panels: Annotated[int, Field(ge=0)]
    predictions: bool
    root: str | None
    batch_size: PositiveInt | None
    workers: Annotated[int, Field(ge=0)] | None
    accelerator: Accelerator
    compile: bool
    metrics: MetricOptions

    @model_validator(mode="after")
    def _fits(self) -> "EvaluateOptions":
        if self.max_depth is not None and self.published is None:
            raise ValueError("max_depth: only for published weights; our checkpoints store it")
        if self.data is not None:
            self.data.split.needs("data.split", self.split)
            if self.data.test or self.data.also:
                raise ValueError("data.test, data.also: are of trainings; col3d evaluate scores on data=...")
        return self

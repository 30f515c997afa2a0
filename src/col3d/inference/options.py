"""Options of the programs that use a trained network: predict, fuse, export, demo."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from col3d.data.options import Size, of_the_table
from col3d.models.published.options import Published
from col3d.nearest_names import check_known
from col3d.registry.fields import Accelerator, NonNegative
from col3d.registry.schema import NoneWord, Options


class CheckpointOptions(Options):
    """Which network: a checkpoint of ours, or of the authors named by `published`."""

    checkpoint: str | None
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None

    @model_validator(mode="after")
    def _knows_its_own(self) -> "CheckpointOptions":
        for option, value in (("max_depth", self.max_depth), ("size", self.size)):
            if value is not None and self.published is None:
                raise ValueError(f"{option}: only for published weights; our checkpoints store it")
        if self.published is not None and self.checkpoint is None:
            raise ValueError("checkpoint: a value is needed for published weights")
        return self


class PredictOptions(CheckpointOptions):
    """Everything that `col3d predict` takes."""

    checkpoint: str
    input: str
    output: str
    overwrite: bool
    camera: Annotated[str | list[float] | None, NoneWord]
    files: bool
    previews: bool
    clouds: Annotated[int, Field(ge=0)]
    video: Literal["auto"] | bool
    fps: PositiveFloat | None
    range: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] | None
    batch_size: PositiveInt
    accelerator: Accelerator
    compile: bool

    @model_validator(mode="after")
    def _fits(self) -> "PredictOptions":
        if self.range is not None and self.range[0] >= self.range[1]:
            raise ValueError(f"range: expected [low,high] with low below high, got {self.range}")
        if self.clouds and self.camera is None:
            raise ValueError("clouds: points need viewing rays; give the camera, such as camera=c3vd")
        return self


class PoseOptions(Options):
    """How the lines of pose.txt are read; `auto` is inferred from depth, else as in C3VD."""

    direction: Literal["auto", "camera_to_world", "world_to_camera"]
    axes: Literal["auto", "opencv", "opengl", "unity"]
    unit: Literal["auto", "mm", "cm", "m"]
    first: Literal["auto"] | Annotated[int, Field(ge=0)]
    check: bool


class FuseOptions(Options):
    """Everything that `col3d fuse` takes."""

    video: str
    dataset: str
    output: str
    overwrite: bool
    checkpoint: str | None
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None
    scale: Literal["none", "median"]
    poses: PoseOptions
    frames: PositiveInt | None
    voxel: Annotated[float, Field(gt=0, le=10)]
    far: PositiveFloat | None
    accelerator: Accelerator

    @model_validator(mode="after")
    def _fits(self) -> "FuseOptions":
        if self.dataset != "auto":
            check_known("dataset", self.dataset, ("auto", *of_the_table()))
        needless = {"published": self.published, "max_depth": self.max_depth}
        if self.checkpoint is None:
            for option, value in needless.items():
                if value is not None:
                    raise ValueError(f"{option}: is of a checkpoint; give checkpoint=PATH")
            if self.scale != "none":
                raise ValueError("scale: is of predictions; give checkpoint=PATH")
        elif self.published is None and (self.size or self.max_depth):
            raise ValueError("size, max_depth: only for published weights; our checkpoints store them")
        return self


class ExportOptions(CheckpointOptions):
    """Everything that `col3d export` takes."""

    checkpoint: str
    output: str
    overwrite: bool
    opset: Annotated[int, Field(ge=18, le=25)] | None
    batch: Annotated[int, Field(ge=1, le=1024)] | None
    half: bool

    @model_validator(mode="after")
    def _knows_its_own(self) -> "ExportOptions":
        if self.max_depth is not None and self.published is None:
            raise ValueError("max_depth: only for published weights; our checkpoints store it")
        return self

    @model_validator(mode="after")
    def _is_of_a_program(self) -> "ExportOptions":
        given = {"size": self.size, "batch": self.batch, "half": self.half or None}
        if self.output.endswith(".ckpt"):
            for option, value in given.items():
                if value is not None:
                    raise ValueError(f"{option}: is of .onnx and .pt2; .ckpt has any size, in half precision")
        if self.opset is not None and not self.output.endswith(".onnx"):
            raise ValueError(f"opset: is of .onnx, got output={self.output}")
        return self

    @model_validator(mode="after")
    def _fits(self) -> "ExportOptions":
        if Path(self.output).suffix not in (".onnx", ".pt2", ".ckpt"):  # `.onnx` alone is a name without one
            raise ValueError(
                f"output: expected a name that ends in .onnx, .pt2 or .ckpt, got {self.output!r}"
            )
        if self.published is not None and self.output.endswith(".ckpt"):
            raise ValueError(f"output: .ckpt is for checkpoints of train.py, got published={self.published}")
        return self


class DemoOptions(CheckpointOptions):
    """Everything that `col3d demo` takes."""

    camera: Annotated[str | list[float] | None, NoneWord]
    port: Annotated[int, Field(ge=1, le=65535)]
    samples: Annotated[str | None, NoneWord]

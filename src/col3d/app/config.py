"""Every option with its type and range: the composed configuration is checked before anything is built."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import (
    Field,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    SerializeAsAny,
    model_validator,
)

from col3d.app.trainer_options import TrainerOptions
from col3d.callback_options import Entries
from col3d.checks import check_known
from col3d.data.options import Data, Size, Split
from col3d.logger_options import Loggers
from col3d.losses.options import LossOptions, Weight
from col3d.metrics import registered_specs
from col3d.metrics.options import MetricOptions
from col3d.models.options import ModelOptions, model_options
from col3d.models.published import SOURCES
from col3d.optimizers import OptimizerOptions, optimizer_options, sample_optimizer
from col3d.registry import CALLBACKS, DATASETS, MODELS
from col3d.schedulers import PlateauOptions, SchedulerOptions, scheduler_options, try_schedule
from col3d.schema import NoneWord, Options

if TYPE_CHECKING:
    Published = str
else:
    Published = Literal[*SOURCES]  # whose weights a checkpoint holds
ByName = Field(discriminator="name")
"""Which of several classes of options is meant is told by their name."""


def of_the_table() -> list[str]:
    """Data sets whose videos are those of `videos.csv`."""
    return [name for name in DATASETS.names() if DATASETS[name].facts["table"]]


Model = Annotated[SerializeAsAny[ModelOptions], PlainValidator(model_options)]
"""A registered network's options: which there are is told by its name."""
TheOptimizer = Annotated[SerializeAsAny[OptimizerOptions], PlainValidator(optimizer_options)]
TheScheduler = Annotated[SerializeAsAny[SchedulerOptions], PlainValidator(scheduler_options)]
"""Likewise."""


class SupervisedOptions(Options):
    """The loss alone."""

    name: Literal["supervised"]


class AdversarialOptions(Options):
    """The loss, and a discriminator that learns beside the network."""

    name: Literal["adversarial"]
    weight: PositiveFloat
    discriminator_width: Annotated[int, Field(ge=8, multiple_of=8)]


class PhantomOptions(Options):
    """What is rendered where data=phantom is not there yet."""

    size: Size
    frames_per_video: Annotated[int, Field(ge=2)]
    seed: Annotated[int, Field(ge=0)]


TaskOptions = SupervisedOptions | AdversarialOptions


class CallbackOptions(Options):
    """What is written beside the metrics, and callbacks that join the training."""

    panels: Annotated[int, Field(ge=0)]
    predictions: bool
    checkpoint_minutes: Weight
    more: Entries = Field(default_factory=dict)


class ProtocolOptions(Options):
    """How predictions are scored; its name stands in every table."""

    mirror: Annotated[Literal["mean", "ramp"] | None, NoneWord]
    resolution: Literal["network", "native"]
    truth: Literal["clean", "mixed"]
    truth_range: Annotated[list[Weight], Field(min_length=2, max_length=2)]
    scaling: Literal["none", "median", "scale_and_shift"]
    cosine_epsilon: Weight
    normal_axes: Literal["house", "published"]
    average: Literal["frame", "video", "pixel"]

    @model_validator(mode="after")
    def _has_a_range(self) -> "ProtocolOptions":
        if self.truth_range[0] >= self.truth_range[1]:
            raise ValueError(
                f"protocol.truth_range: expected [low,high] with low below high, got {self.truth_range}"
            )
        return self


Protocols = Annotated[dict[str, ProtocolOptions], Field(min_length=1)]
"""By name: `protocol=house`, or `protocol=[house,published]` where several can be."""


class InitOptions(Options):
    """Weights to begin from."""

    checkpoint: str | None = None
    published: Published | None = None

    @model_validator(mode="after")
    def _has_a_file(self) -> "InitOptions":
        if self.published is not None and self.checkpoint in (None, "shipped"):
            raise ValueError("init.published: says whose weights a file holds; give init.checkpoint=PATH")
        return self


class TrainOptions(Options):
    """Everything that `train.py` takes."""

    seed: Annotated[int, Field(ge=0, lt=2**32)]
    overwrite: bool
    output_dir: str
    objective: Annotated[list[str], Field(min_length=1)]
    preset: str
    init: InitOptions = InitOptions()
    model: Model
    plugins: list[str] = Field(default_factory=list)
    task: Annotated[TaskOptions, ByName]
    loss: LossOptions
    data: Data
    phantom: PhantomOptions
    optimizer: TheOptimizer
    scheduler: TheScheduler
    trainer: TrainerOptions
    callbacks: CallbackOptions
    logger: Loggers
    protocol: Protocols
    metrics: MetricOptions

    @model_validator(mode="after")
    def _parts_fit(self) -> "TrainOptions":
        loss, model = self.loss, self.model
        tested: tuple[Split, ...] = ("test",) if self.data.test is None else ()
        self.data.split.needs("data.split", "train", "val", *tested)
        asked = loss.needing("normals")
        if asked and model.normals == "none":
            raise ValueError(
                f"loss: {' and '.join(asked)} cannot be served, because model={model.name} predicts no "
                "normals with model.normals=none; take model.normals=unc, or loss=silog"
            )
        if not asked and model.normals != "none":
            alone = MODELS[model.name].facts["depth_alone"]
            depth_alone = f"model={alone}" if alone else "model.normals=none"
            raise ValueError(
                f"loss: model={model.name} predicts normals, and no term of this loss would teach them; "
                f"take loss=mtl or mtl_xtc, or {depth_alone}"
            )
        if len(loss.lambdas) != len(loss.terms):
            raise ValueError(
                f"loss.lambdas: expected {len(loss.terms)} number(s) for model={model.name} "
                f"({', '.join(loss.terms)}), got {len(loss.lambdas)}: {loss.lambdas}"
            )
        if len(self.protocol) > 1 or self.one_protocol[1].resolution == "native":
            raise ValueError(
                "protocol: train.py scores under one protocol, at the network's resolution; "
                f"got {', '.join(self.protocol)}; col3d evaluate scores under any"
            )
        if self.callbacks.predictions and self.trainer.processes != 1:
            nodes = "" if self.trainer.num_nodes == 1 else f" trainer.num_nodes={self.trainer.num_nodes}"
            raise ValueError(
                f"callbacks.predictions: one process writes them, got trainer.devices={self.trainer.devices}"
                f"{nodes}"
            )
        if self.task.name == "adversarial":
            self._adversarial_fits()
        if model.unfreeze_at is not None and model.unfreeze_at >= self.trainer.max_epochs:
            raise ValueError(
                f"model.unfreeze_at: expected fewer than trainer.max_epochs={self.trainer.max_epochs}, "
                f"got {model.unfreeze_at}"
            )
        specs = registered_specs(task="depth" if model.normals == "none" else None, validation=True)
        measured = [f"val/{name}" for name in ("loss", *specs)]
        if unknown := [name for name in self.objective if name not in measured]:
            raise ValueError(
                f"objective: {', '.join(unknown)} is not measured with model={model.name}; there are "
                f"{', '.join(measured)}"
            )
        self._schedule_fits(measured)
        self._callbacks_fit(measured)
        if not any(loss.lambdas):
            raise ValueError(f"loss.lambdas: at least one weight must be above 0, got {loss.lambdas}")
        if loss.learning_from("normals") and self.data.normals == "none":
            raise ValueError("data.normals: the loss needs normals, got none; take stored or derived")
        return self

    @property
    def one_protocol(self) -> tuple[str, ProtocolOptions]:
        """The protocol that the training scores under, and its name."""
        return next(iter(self.protocol.items()))

    def _callbacks_fit(self, measured: list[str]) -> None:
        """What callbacks of Lightning watch is measured."""
        logged = [f"train/{name}" for name in ("loss", *(f"loss_{term}" for term in self.loss.terms), "lr")]
        for name, entry in self.callbacks.more.items():
            monitor = getattr(entry, "monitor", None)
            if isinstance(monitor, str) and CALLBACKS[entry.callback].package == "lightning":
                check_known(f"callbacks.more.{name}.monitor", monitor, [*measured, *logged])

    def _schedule_fits(self, measured: list[str]) -> None:
        """Torch's rules for the schedule beside this optimiser, and what it watches."""
        try_schedule(self.scheduler, sample_optimizer(self.optimizer), self.trainer.max_epochs)
        if isinstance(self.scheduler, PlateauOptions):
            check_known("scheduler.monitor", self.scheduler.monitor, measured)
            if self.task.name == "adversarial":
                raise ValueError(f"scheduler: {self.scheduler.name} is not for task=adversarial")

    def _adversarial_fits(self) -> None:
        given = self.trainer
        if given.accumulate > 1:
            raise ValueError(f"trainer.accumulate: task=adversarial steps each batch, got {given.accumulate}")
        if given.gradient_clip_algorithm == "value":
            raise ValueError("trainer.gradient_clip_algorithm: task=adversarial clips by norm, got value")
        if given.gradient_clip is not None and given.precision == "16-mixed":
            raise ValueError(
                "trainer.gradient_clip: task=adversarial cannot clip scaled gradients; take bf16-mixed"
            )


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
    root: str | None
    batch_size: PositiveInt | None
    workers: Annotated[int, Field(ge=0)] | None
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]
    compile: bool
    metrics: MetricOptions

    @model_validator(mode="after")
    def _fits(self) -> "EvaluateOptions":
        if self.max_depth is not None and self.published is None:
            raise ValueError("max_depth: our checkpoints know theirs; it is for published weights")
        if self.data is not None:
            self.data.split.needs("data.split", self.split)
            if self.data.test or self.data.also:
                raise ValueError("data.test, data.also: are of trainings; col3d evaluate scores on data=...")
        return self


class BenchmarkOptions(Options):
    """What `col3d benchmark` takes beside the options of `train.py`."""

    experiments: Annotated[list[str], Field(min_length=1)]
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)]
    epochs: dict[str, PositiveInt]
    parallel: PositiveInt | None
    output: str


class BenchmarkFile(Options):
    """The part of the configuration that is `col3d benchmark`'s own."""

    benchmark: BenchmarkOptions


class PrepareFileOptions(Options):
    """What `col3d prepare` takes beside data and phantom."""

    preset: str | None
    out: str | None


class PrepareOptions(Options):
    """Everything that `col3d prepare` takes."""

    data: Data
    phantom: PhantomOptions
    prepare: PrepareFileOptions
    workers: Annotated[int, Field(ge=1)] | None


class VerifyOptions(Options):
    """Everything that `col3d verify` takes."""

    data: Data
    phantom: PhantomOptions
    fast: bool
    output: str
    workers: Annotated[int, Field(ge=1)] | None

    @model_validator(mode="after")
    def _fits(self) -> "VerifyOptions":
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; col3d verify checks data=...")
        return self


class DownloadOptions(Options):
    """Everything that `col3d download` takes."""

    data: Data
    videos: Literal["split", "all"] | Annotated[list[str], Field(min_length=1)]
    accept_licence: bool
    keep: bool
    parallel: Annotated[int, Field(ge=1, le=16)]
    attempts: Annotated[int, Field(ge=1, le=1000)]
    timeout: Annotated[float, Field(gt=0, le=3600)]
    server: str
    doi: str

    @model_validator(mode="after")
    def _is_published_there(self) -> "DownloadOptions":
        if not re.fullmatch(r"https?://[^/\s?#]+(/[^\s?#]*)?", self.server):
            raise ValueError(
                f"server: expected an address such as https://archive.data.jhu.edu, got {self.server!r}"
            )
        if not re.fullmatch(r"(doi|hdl):\S+", self.doi):
            raise ValueError(f"doi: expected one such as doi:10.7281/T1/JC64MK, got {self.doi!r}")
        if not DATASETS[self.data.name].facts["table"]:
            raise ValueError(
                f"data: {' and '.join(of_the_table())} can be downloaded, got data={self.data.name}"
            )
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; col3d download fetches data=...")
        return self


class LearntOptions(Options):
    """Which network: a checkpoint of ours, or of the authors named by `published`."""

    checkpoint: str
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None

    @model_validator(mode="after")
    def _knows_its_own(self) -> "LearntOptions":
        for option, value in (("max_depth", self.max_depth), ("size", self.size)):
            if value is not None and self.published is None:
                raise ValueError(f"{option}: our checkpoints know theirs; it is for published weights")
        return self


class PredictOptions(LearntOptions):
    """Everything that `col3d predict` takes."""

    input: str
    output: str
    overwrite: bool
    camera: Annotated[str | list[float] | None, NoneWord]
    files: bool
    previews: bool
    clouds: Annotated[int, Field(ge=0)]
    video: Literal["auto"] | bool
    fps: PositiveFloat | None
    range: Annotated[list[Weight], Field(min_length=2, max_length=2)] | None
    batch_size: PositiveInt
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]
    compile: bool

    @model_validator(mode="after")
    def _fits(self) -> "PredictOptions":
        if self.range is not None and self.range[0] >= self.range[1]:
            raise ValueError(f"range: expected [low,high] with low below high, got {self.range}")
        if self.clouds and self.camera is None:
            raise ValueError("clouds: points need viewing rays; give the camera, such as camera=c3vd")
        return self


class PoseOptions(Options):
    """What the lines of pose.txt mean; what is `auto` is told by depth, and C3VD's where nothing tells."""

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
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]

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
            raise ValueError("size, max_depth: our checkpoints know theirs; they are for published weights")
        return self


class ExportOptions(LearntOptions):
    """Everything that `col3d export` takes."""

    output: str
    overwrite: bool
    opset: Annotated[int, Field(ge=18, le=25)] | None
    batch: Annotated[int, Field(ge=1, le=1024)] | None
    half: bool

    @model_validator(mode="after")
    def _knows_its_own(self) -> "ExportOptions":
        if self.max_depth is not None and self.published is None:
            raise ValueError("max_depth: our checkpoints know theirs; it is for published weights")
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


class DemoOptions(Options):
    """Everything that `col3d demo` takes."""

    checkpoint: str | None
    published: Published | None
    max_depth: PositiveFloat | None
    size: Size | None
    camera: Annotated[str | list[float] | None, NoneWord]
    port: Annotated[int, Field(ge=1, le=65535)]
    samples: Annotated[str | None, NoneWord]

    @model_validator(mode="after")
    def _fits(self) -> "DemoOptions":
        for option in ("max_depth", "size"):
            if getattr(self, option) is not None and self.published is None:
                raise ValueError(f"{option}: our checkpoints know theirs; it is for published weights")
        if self.published is not None and self.checkpoint is None:
            raise ValueError("checkpoint: a value is needed for published weights")
        return self

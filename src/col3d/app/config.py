"""Every option with its type and range: the composed configuration is checked before anything is built."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    Field,
    PlainValidator,
    PositiveFloat,
    PositiveInt,
    SerializeAsAny,
    model_validator,
)

from col3d.losses.options import LossOptions, Weight
from col3d.metrics import registered_specs
from col3d.metrics.options import MetricOptions
from col3d.models.options import ModelOptions, model_options
from col3d.optimizers import OptimizerOptions, optimizer_options
from col3d.registry import MODELS
from col3d.schema import NoneWord, Options

Split = Literal["train", "val", "test"]
Published = Literal["bts", "col3d_bts_cbam", "col3d_mtl_no_xtc", "col3d_mtl", "newcrfs", "monodepth_fpn"]
"""Whose weights a checkpoint holds: `col3d.models.published`."""
Probability = Annotated[float, Field(ge=0, le=1)]
Side = Annotated[int, Field(ge=64)]
"""Of frames that networks see: a batch of one needs more than one cell at 1/32."""
ByName = Field(discriminator="name")
"""Which of several classes of options is meant is told by their name."""


Model = Annotated[SerializeAsAny[ModelOptions], PlainValidator(model_options)]
"""A registered network's options: which there are is told by its name."""
TheOptimizer = Annotated[SerializeAsAny[OptimizerOptions], PlainValidator(optimizer_options)]
"""Likewise."""


class SupervisedOptions(Options):
    """The loss alone."""

    name: Literal["supervised"]


class AdversarialOptions(Options):
    """The loss, and a discriminator that learns beside the network."""

    name: Literal["adversarial"]
    weight: PositiveFloat
    discriminator_width: Annotated[int, Field(ge=8, multiple_of=8)]


class SplitOptions(Options):
    """Videos, labels of the paper or frame ranges of each part."""

    name: str
    train: list[str]
    val: list[str]
    test: list[str]

    def needs(self, option: str, *parts: Split) -> None:
        """Refuse parts that are used and empty.

        Raises:
            ValueError: names the option.
        """
        for part in parts:
            if not getattr(self, part):
                raise ValueError(f"{option}.{part}: a value is needed; give {option}.{part}=[VIDEO,...]")


class AugmentOptions(Options):
    """Random transforms of training batches."""

    rotation: Annotated[float, Field(ge=0, le=180)]
    flip: Probability
    crop: Annotated[float, Field(gt=0, le=1)]
    jitter: Probability


class PhantomOptions(Options):
    """What is rendered where data=phantom is not there yet."""

    size: Annotated[list[Side], Field(min_length=2, max_length=2)]
    frames_per_video: Annotated[int, Field(ge=2)]
    seed: Annotated[int, Field(ge=0)]


class LayoutOptions(Options):
    """How the files of `data=folder` are called and what they hold; see `col3d.data.folder`."""

    image: str
    depth: str
    depth_unit: PositiveFloat
    max_depth: PositiveFloat
    camera_file: str
    depth_channel: Annotated[int, Field(ge=0)] | None = None
    depth_offset: int | None = None
    stamp_tolerance: PositiveFloat = 0.02


class SourceOptions(Options):
    """A data set and its split."""

    name: Literal["phantom", "c3vd", "c3vdv2", "simcol3d", "folder"]
    root: str
    release: Literal["auto", "current", "pre_2023_05"]
    normals: Literal["stored", "derived", "none"]
    split: SplitOptions
    allow_missing: bool
    store: str = "auto"
    randomise: bool | list[Literal["anatomy", "tissue", "light", "sensor"]] = False
    weight: PositiveFloat = 1.0
    layout: LayoutOptions | None = None

    @model_validator(mode="after")
    def _has_what_it_says(self) -> "SourceOptions":
        if self.normals == "stored" and self.name in ("simcol3d", "folder"):
            raise ValueError(f"data.normals: {self.name} stores none; take derived or none")
        if self.randomise and self.name != "phantom":
            raise ValueError(f"data.randomise: belongs to data=phantom, got data={self.name}")
        if (self.layout is None) == (self.name == "folder"):
            raise ValueError(f"data.layout: belongs to data=folder, got data={self.name}")
        return self


class DataOptions(SourceOptions):
    """The data set that is trained on, how its frames are fed, and others to test on or train on."""

    size: Annotated[list[Side], Field(min_length=2, max_length=2)]
    batch_size: PositiveInt
    workers: Annotated[int, Field(ge=0)]
    augment: AugmentOptions
    test: SourceOptions | None = None
    also: dict[str, SourceOptions] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _belong_together(self) -> "DataOptions":
        for name, source in self.also.items():
            source.split.needs(f"data.also.{name}.split", "train")
            if (source.normals == "none") != (self.normals == "none"):
                raise ValueError(
                    f"data.also.{name}.normals: all that is trained on has normals or none has; got "
                    f"{source.normals} beside {self.normals}"
                )
        if self.test is not None:
            self.test.split.needs("data.test.split", "test")
        return self

    @property
    def tested(self) -> SourceOptions:
        """The data set that is tested on."""
        return self.test or self


class ConstantOptions(Options):
    """One learning rate throughout."""

    name: Literal["constant"]


class PolynomialOptions(Options):
    """`hold` is the share of the steps before the learning rate begins to fall."""

    name: Literal["polynomial"]
    power: PositiveFloat
    final_ratio: Probability
    hold: Annotated[float, Field(ge=0, lt=1)]


class StepOptions(Options):
    """The learning rate times `factor` after every `epochs`."""

    name: Literal["step"]
    epochs: PositiveInt
    factor: Annotated[float, Field(gt=0, le=1)]


SchedulerOptions = ConstantOptions | PolynomialOptions | StepOptions
TaskOptions = SupervisedOptions | AdversarialOptions


class TrainerOptions(Options):
    """What Lightning's Trainer is given."""

    max_epochs: PositiveInt
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]
    devices: PositiveInt | Literal["auto"]
    strategy: Literal["auto", "ddp"]
    precision: Literal["32-true", "bf16-mixed", "16-mixed"]
    gradient_clip: Annotated[PositiveFloat | None, NoneWord]
    accumulate: PositiveInt
    compile: bool
    deterministic: bool
    limit_train_batches: PositiveInt | None


class CallbackOptions(Options):
    """What is written beside the metrics."""

    panels: Annotated[int, Field(ge=0)]
    predictions: bool
    checkpoint_minutes: Weight


class LoggerOptions(Options):
    """`csv` always; `wandb` adds Weights & Biases."""

    name: Literal["csv", "wandb"]
    project: Annotated[str, Field(pattern=r"^[^/\\#?%:]+$")]
    offline: bool


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
    data: DataOptions
    phantom: PhantomOptions
    optimizer: TheOptimizer
    scheduler: Annotated[SchedulerOptions, ByName]
    trainer: TrainerOptions
    callbacks: CallbackOptions
    logger: LoggerOptions
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
                f"got {', '.join(self.protocol)}; evaluate.py scores under any"
            )
        if self.callbacks.predictions and self.trainer.devices != 1:
            raise ValueError(
                f"callbacks.predictions: one process writes them, got trainer.devices={self.trainer.devices}"
            )
        if self.task.name == "adversarial":
            self._adversarial_fits()
        specs = registered_specs(task="depth" if model.normals == "none" else None, validation=True)
        measured = [f"val/{name}" for name in ("loss", *specs)]
        if unknown := [name for name in self.objective if name not in measured]:
            raise ValueError(
                f"objective: {', '.join(unknown)} is not measured with model={model.name}; there are "
                f"{', '.join(measured)}"
            )
        if not any(loss.lambdas):
            raise ValueError(f"loss.lambdas: at least one weight must be above 0, got {loss.lambdas}")
        if loss.learning_from("normals") and self.data.normals == "none":
            raise ValueError("data.normals: the loss needs normals, got none; take stored or derived")
        return self

    @property
    def one_protocol(self) -> tuple[str, ProtocolOptions]:
        """The protocol that the training scores under, and its name."""
        return next(iter(self.protocol.items()))

    def _adversarial_fits(self) -> None:
        given = self.trainer
        if given.accumulate > 1:
            raise ValueError(f"trainer.accumulate: task=adversarial steps each batch, got {given.accumulate}")
        if given.gradient_clip is not None and given.precision == "16-mixed":
            raise ValueError(
                "trainer.gradient_clip: task=adversarial cannot clip scaled gradients; take bf16-mixed"
            )


class EvaluateOptions(Options):
    """Everything that `evaluate.py` takes; what is null stays as the checkpoint was trained.

    `data` and `phantom` may be left out; `published` names the program whose weights the checkpoint holds.
    """

    checkpoint: str
    published: Published | None
    max_depth: PositiveFloat | None
    size: Annotated[list[Side], Field(min_length=2, max_length=2)] | None
    protocol: Protocols
    data: DataOptions | None = None
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
                raise ValueError("data.test, data.also: are of trainings; evaluate.py scores on data=...")
        return self


class BenchmarkOptions(Options):
    """What `benchmark.py` takes beside the options of `train.py`."""

    experiments: Annotated[list[str], Field(min_length=1)]
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)]
    epochs: dict[str, PositiveInt]
    parallel: PositiveInt | None
    output: str


class BenchmarkFile(Options):
    """The part of the configuration that is `benchmark.py`'s own."""

    benchmark: BenchmarkOptions


class PrepareFileOptions(Options):
    """What `prepare.py` takes beside data and phantom."""

    preset: str | None
    out: str | None


class PrepareOptions(Options):
    """Everything that `prepare.py` takes."""

    data: DataOptions
    phantom: PhantomOptions
    prepare: PrepareFileOptions
    workers: Annotated[int, Field(ge=1)] | None


class VerifyOptions(Options):
    """Everything that `verify.py` takes."""

    data: DataOptions
    phantom: PhantomOptions
    fast: bool
    output: str
    workers: Annotated[int, Field(ge=1)] | None

    @model_validator(mode="after")
    def _fits(self) -> "VerifyOptions":
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; verify.py checks data=...")
        return self


class DownloadOptions(Options):
    """Everything that `download.py` takes."""

    data: DataOptions
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
        if self.data.name not in ("c3vd", "c3vdv2"):
            raise ValueError(f"data: c3vd and c3vdv2 can be downloaded, got data={self.data.name}")
        if self.data.test or self.data.also:
            raise ValueError("data.test, data.also: are of trainings; download.py fetches data=...")
        return self


class LearntOptions(Options):
    """Which network: a checkpoint of ours, or of the authors named by `published`."""

    checkpoint: str
    published: Published | None
    max_depth: PositiveFloat | None
    size: Annotated[list[Side], Field(min_length=2, max_length=2)] | None

    @model_validator(mode="after")
    def _knows_its_own(self) -> "LearntOptions":
        for option, value in (("max_depth", self.max_depth), ("size", self.size)):
            if value is not None and self.published is None:
                raise ValueError(f"{option}: our checkpoints know theirs; it is for published weights")
        return self


class PredictOptions(LearntOptions):
    """Everything that `predict.py` takes."""

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
    """Everything that `fuse.py` takes."""

    video: str
    dataset: Literal["auto", "c3vd", "c3vdv2"]
    output: str
    overwrite: bool
    checkpoint: str | None
    published: Published | None
    max_depth: PositiveFloat | None
    size: Annotated[list[Side], Field(min_length=2, max_length=2)] | None
    scale: Literal["none", "median"]
    poses: PoseOptions
    frames: PositiveInt | None
    voxel: Annotated[float, Field(gt=0, le=10)]
    far: PositiveFloat | None
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]

    @model_validator(mode="after")
    def _fits(self) -> "FuseOptions":
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
    """Everything that `export.py` takes."""

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


class AppOptions(Options):
    """Everything that `app.py` takes."""

    checkpoint: str | None
    published: Published | None
    max_depth: PositiveFloat | None
    size: Annotated[list[Side], Field(min_length=2, max_length=2)] | None
    camera: Annotated[Literal["c3vd", "c3vdv2", "simcol3d"] | list[float] | None, NoneWord]
    port: Annotated[int, Field(ge=1, le=65535)]
    samples: Annotated[str | None, NoneWord]

    @model_validator(mode="after")
    def _fits(self) -> "AppOptions":
        for option in ("max_depth", "size"):
            if getattr(self, option) is not None and self.published is None:
                raise ValueError(f"{option}: our checkpoints know theirs; it is for published weights")
        if self.published is not None and self.checkpoint is None:
            raise ValueError("checkpoint: a value is needed for published weights")
        return self

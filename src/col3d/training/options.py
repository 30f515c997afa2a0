"""Options of a training with their types and ranges, validated before anything is built."""

from typing import Annotated, Literal

from pydantic import Field, PlainValidator, PositiveFloat, PositiveInt, SerializeAsAny, model_validator

from col3d.data.options import Data, Split
from col3d.evaluation.options import ProtocolOptions, Protocols
from col3d.losses.options import LossOptions
from col3d.metrics import registered_specs
from col3d.metrics.options import MetricOptions
from col3d.models.options import Model
from col3d.models.published.options import Published
from col3d.nearest_names import check_known
from col3d.phantom.options import PhantomOptions
from col3d.registry import CALLBACKS, MODELS
from col3d.registry.fields import NonNegative
from col3d.registry.schema import Options
from col3d.runs.logger_options import Loggers
from col3d.training.callback_options import Entries
from col3d.training.optimizers import OptimizerOptions, optimizer_options, sample_optimizer
from col3d.training.schedulers import PlateauOptions, SchedulerOptions, scheduler_options, try_schedule
from col3d.training.trainer_options import TrainerOptions

ByName = Field(discriminator="name")
"""Selects one of several option classes by `name`."""


TheOptimizer = Annotated[SerializeAsAny[OptimizerOptions], PlainValidator(optimizer_options)]
"""Options of the optimiser, validated against its signature."""
TheScheduler = Annotated[SerializeAsAny[SchedulerOptions], PlainValidator(scheduler_options)]
"""Options of the scheduler, validated against its signature."""


class SupervisedOptions(Options):
    """The loss alone."""

    name: Literal["supervised"]


class AdversarialOptions(Options):
    """The loss, and a discriminator that learns beside the network."""

    name: Literal["adversarial"]
    weight: PositiveFloat
    discriminator_width: Annotated[int, Field(ge=8, multiple_of=8)]


TaskOptions = SupervisedOptions | AdversarialOptions


class CallbackOptions(Options):
    """What is written beside the metrics, and callbacks that join the training."""

    panels: Annotated[int, Field(ge=0)]
    predictions: bool
    checkpoint_minutes: NonNegative
    more: Entries = Field(default_factory=dict)


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
        terms = loss.needing("normals")
        if terms and model.normals == "none":
            raise ValueError(
                f"loss: {' and '.join(terms)} cannot be served, because model={model.name} predicts no "
                "normals with model.normals=none; take model.normals=unc, or loss=silog"
            )
        if not terms and model.normals != "none":
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
        if self.one_protocol[1].scaling_over == "video" and self.trainer.processes != 1:
            raise ValueError(
                f"protocol: {self.one_protocol[0]} aligns a video's frames together, in one process, got "
                f"trainer.devices={self.trainer.devices}; col3d evaluate scores the checkpoint afterwards"
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
        """Name and options of the protocol that the training scores under."""
        return next(iter(self.protocol.items()))

    def _callbacks_fit(self, measured: list[str]) -> None:
        """Refuse callbacks of Lightning that monitor a metric which is not measured."""
        logged = [f"train/{name}" for name in ("loss", *(f"loss_{term}" for term in self.loss.terms), "lr")]
        for name, entry in self.callbacks.more.items():
            monitor = getattr(entry, "monitor", None)
            if isinstance(monitor, str) and CALLBACKS[entry.callback].package == "lightning":
                check_known(f"callbacks.more.{name}.monitor", monitor, [*measured, *logged])

    def _schedule_fits(self, measured: list[str]) -> None:
        """Check torch's rules for the schedule with this optimiser, and the metric that it monitors."""
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

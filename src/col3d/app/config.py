"""Every option with its type and range: the composed configuration is checked before anything is built."""

from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    model_validator,
)

Split = Literal["train", "val", "test"]
Weight = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1)]
Side = Annotated[int, Field(ge=64)]
"""Of frames that networks see: a batch of one needs more than one cell at 1/32."""
NoneWord = BeforeValidator(lambda value: None if value == "none" else value)
"""Lets `none` on a command line stand for null."""


class Options(BaseModel):
    """Base of all groups: nothing that is not declared, nothing changed once checked."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ModelOptions(Options):
    """A network of `col3d.models`."""

    name: Literal["bts", "bts_cbam", "bts_cbam_mtl", "col3d_mtl"]
    encoder: str
    pretrained: Annotated[str | None, NoneWord]
    max_depth: PositiveFloat
    width: Annotated[int, Field(ge=64, multiple_of=64)]

    @property
    def predicts_normals(self) -> bool:
        """Whether the network has a decoder for normals."""
        from col3d.models import NETWORKS

        return "normals" in NETWORKS[self.name].tasks


class LossOptions(Options):
    """Terms of `col3d.losses.WeightedLoss`, and a weight for each."""

    depth: Literal["silog"]
    normals: Annotated[Literal["l1", "l2"] | None, NoneWord]
    consistency: Annotated[Literal["rmse", "l1"] | None, NoneWord]
    geometry: Literal["rays", "pinhole"]
    lambdas: list[Weight]

    @property
    def terms(self) -> list[str]:
        """Names of the terms in the order of their weights."""
        return [name for name in ("depth", "normals", "consistency") if getattr(self, name) is not None]


class SplitOptions(Options):
    """Videos, labels of the paper or frame ranges of each part."""

    name: str
    train: Annotated[list[str], Field(min_length=1)]
    val: Annotated[list[str], Field(min_length=1)]
    test: Annotated[list[str], Field(min_length=1)]


class AugmentOptions(Options):
    """Random transforms of training batches."""

    rotation: Annotated[float, Field(ge=0, le=180)]
    flip: Probability
    jitter: Probability


class PhantomOptions(Options):
    """What is rendered where data=phantom is not there yet."""

    size: Annotated[list[Side], Field(min_length=2, max_length=2)]
    frames_per_video: Annotated[int, Field(ge=2)]
    seed: Annotated[int, Field(ge=0)]


class DataOptions(Options):
    """Frames, their split, size and batches."""

    name: Literal["phantom", "c3vd"]
    root: str
    release: Literal["auto", "current", "pre_2023_05"]
    normals: Literal["stored", "derived", "none"]
    split: SplitOptions
    allow_missing: bool
    size: Annotated[list[Side], Field(min_length=2, max_length=2)]
    batch_size: PositiveInt
    workers: Annotated[int, Field(ge=0)]
    augment: AugmentOptions


class OptimizerOptions(Options):
    """AdamW or Adam."""

    name: Literal["adamw", "adam"]
    lr: PositiveFloat
    weight_decay: Weight
    eps: PositiveFloat
    betas: Annotated[list[Annotated[float, Field(ge=0, lt=1)]], Field(min_length=2, max_length=2)]


class SchedulerOptions(Options):
    """Learning rate over the steps of training."""

    name: Literal["polynomial", "constant"]
    power: PositiveFloat
    final_ratio: Probability


class TrainerOptions(Options):
    """What Lightning's Trainer is given."""

    max_epochs: PositiveInt
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]
    devices: PositiveInt | Literal["auto"]
    strategy: Literal["auto", "ddp"]
    precision: Literal["32-true", "bf16-mixed", "16-mixed"]
    gradient_clip: Annotated[PositiveFloat | None, NoneWord]
    accumulate: PositiveInt
    deterministic: bool
    limit_train_batches: PositiveInt | None


class CallbackOptions(Options):
    """What is written beside the metrics."""

    panels: Annotated[int, Field(ge=0)]


class LoggerOptions(Options):
    """`csv` always; `wandb` adds Weights & Biases."""

    name: Literal["csv", "wandb"]
    project: Annotated[str, Field(pattern=r"^[^/\\#?%:]+$")]
    offline: bool


class ProtocolOptions(Options):
    """How predictions are scored; the name stands in every table."""

    name: Literal["house"]


class TrainOptions(Options):
    """Everything that `train.py` takes."""

    seed: Annotated[int, Field(ge=0, lt=2**32)]
    overwrite: bool
    output_dir: str
    preset: str
    model: ModelOptions
    loss: LossOptions
    data: DataOptions
    phantom: PhantomOptions
    optimizer: OptimizerOptions
    scheduler: SchedulerOptions
    trainer: TrainerOptions
    callbacks: CallbackOptions
    logger: LoggerOptions
    protocol: ProtocolOptions

    @model_validator(mode="after")
    def _parts_fit(self) -> "TrainOptions":
        loss, model = self.loss, self.model
        asked = [term for term in loss.terms if term != "depth"]
        if asked and not model.predicts_normals:
            raise ValueError(
                f"loss: {' and '.join(asked)} cannot be served, because model={model.name} "
                "predicts no normals; take loss=silog, or model=bts_cbam_mtl or col3d_mtl"
            )
        if len(loss.lambdas) != len(loss.terms):
            raise ValueError(
                f"loss.lambdas: expected {len(loss.terms)} weight(s) for model={model.name} "
                f"({', '.join(loss.terms)}), got {len(loss.lambdas)}: {loss.lambdas}"
            )
        if not any(loss.lambdas):
            raise ValueError(f"loss.lambdas: at least one weight must be above 0, got {loss.lambdas}")
        if "normals" in loss.terms and self.data.normals == "none":
            raise ValueError("data.normals: the loss needs normals, got none; take stored or derived")
        return self


class EvaluateOptions(Options):
    """Everything that `evaluate.py` takes; what is null stays as the checkpoint was trained."""

    checkpoint: str
    output_dir: str | None
    split: Split
    panels: Annotated[int, Field(ge=0)]
    root: str | None
    batch_size: PositiveInt | None
    workers: Annotated[int, Field(ge=0)] | None
    accelerator: Literal["auto", "cpu", "gpu", "cuda"]


class PrepareOptions(Options):
    """Everything that `prepare.py` takes."""

    data: DataOptions
    phantom: PhantomOptions
    workers: Annotated[int, Field(ge=1)] | None

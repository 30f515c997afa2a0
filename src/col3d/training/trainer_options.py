"""Options of Lightning's Trainer, and arguments of it that are refused because a training can be resumed."""

from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from col3d.errors import OptionError
from col3d.registry.schema import NoneWord, Options

Limit = Annotated[PositiveInt | Annotated[float, Field(gt=0, le=1)] | None, NoneWord]
"""A number of batches, or a share of them below 1."""

REASONS = {
    "accumulate_grad_batches": "is called trainer.accumulate here",
    "gradient_clip_val": "is called trainer.gradient_clip here",
    "max_steps": "a training is as long as trainer.max_epochs; trainer.limit_train_batches shortens these",
    "min_steps": "a training is counted in epochs; take trainer.min_epochs",
    "max_time": "take callbacks.more.t=Timer callbacks.more.t.duration=DD:HH:MM:SS, kept in checkpoints",
    "val_check_interval": "validation follows whole epochs; take trainer.check_val_every_n_epoch",
    "num_sanity_val_steps": "trainer.fast_dev_run=true tries everything beforehand",
    "limit_predict_batches": "a training predicts nothing",
    "reload_dataloaders_every_n_epochs": "a loader goes on where a checkpoint was saved",
    "use_distributed_sampler": "samplers are set up so that a test counts each frame once",
    "inference_mode": "validation and test need no gradients",
    "logger": "is a group, logger=[tensorboard,wandb]",
    "callbacks": "take callbacks.more.ENTRY=NAME",
    "plugins": "nothing of a configuration is imported; plugins=[PACKAGE] brings parts of your own",
    "default_root_dir": "the run's folder is hydra.run.dir",
    "enable_checkpointing": "a training that goes on needs its checkpoints",
    "enable_progress_bar": "a terminal shows one, a file does not",
    "enable_model_summary": "take callbacks.more.summary=ModelSummary",
    "enable_autolog_hparams": "loggers are given all options",
    "barebones": "it would keep no checkpoint",
    "model_registry": "belongs to a service of Lightning's",
}
"""Arguments of the Trainer that are not taken, and what to do instead."""


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
    cudagraphs: bool = False
    deterministic: bool | Literal["warn"]
    limit_train_batches: Limit
    limit_val_batches: Limit = None
    limit_test_batches: Limit = None
    overfit_batches: Limit = None
    check_val_every_n_epoch: PositiveInt | None = None
    min_epochs: PositiveInt | None = None
    num_nodes: PositiveInt = 1
    gradient_clip_algorithm: Literal["norm", "value"] | None = None
    sync_batchnorm: bool | None = None
    benchmark: bool | None = None
    detect_anomaly: bool | None = None
    log_every_n_steps: PositiveInt | None = None
    profiler: Annotated[Literal["simple", "advanced", "pytorch"] | None, NoneWord] = None
    fast_dev_run: bool | PositiveInt | None = None

    @model_validator(mode="before")
    @classmethod
    def _serve_here(cls, given: Any) -> Any:
        """Refuse arguments of Lightning's Trainer that are not offered here, with the reason."""
        known = REASONS if isinstance(given, dict) else {}
        if lines := [f"trainer.{name}: {known[name]}" for name in given if name in known]:
            raise OptionError("\n".join(lines))
        return given

    @model_validator(mode="after")
    def _belong_together(self) -> "TrainerOptions":
        every = self.check_val_every_n_epoch or 1
        if every > self.max_epochs:
            raise OptionError(
                f"trainer.check_val_every_n_epoch: expected at most trainer.max_epochs={self.max_epochs}, "
                f"got {every}: the best epoch is one that is validated"
            )
        if self.cudagraphs and not self.compile:
            raise OptionError("trainer.cudagraphs: needs trainer.compile=true")
        if self.gradient_clip_algorithm is not None and self.gradient_clip is None:
            raise OptionError("trainer.gradient_clip_algorithm: needs trainer.gradient_clip")
        if self.overfit_batches is not None and self.limit_train_batches is not None:
            raise OptionError("trainer.overfit_batches: limits training, too; leave out limit_train_batches")
        return self

    @property
    def processes(self) -> int | str:
        """Number of processes, or "auto" if it is not known yet."""
        return self.devices if self.devices == "auto" else self.devices * self.num_nodes

    def tried(self) -> "TrainerOptions":
        """Return the options of a trial run: one epoch with `fast_dev_run` batches of everything."""
        batches = int(self.fast_dev_run or 1)
        limits = ("limit_train_batches", "limit_val_batches", "limit_test_batches")
        nothing = dict.fromkeys(("fast_dev_run", "check_val_every_n_epoch", "min_epochs", "overfit_batches"))
        changes = {"max_epochs": 1, **dict.fromkeys(limits, batches), **nothing}
        return self.model_copy(update=changes)

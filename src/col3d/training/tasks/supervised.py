"""Supervised training of depth, and of normals if the network predicts them."""

import zlib
from collections.abc import Mapping
from typing import Any

import torch
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim.lr_scheduler import LRScheduler, OneCycleLR, ReduceLROnPlateau
from torchmetrics import MeanMetric

from col3d.batch import Batch, Prediction, check_prediction, normals_mask
from col3d.errors import UserError
from col3d.layers.network import measured_tasks
from col3d.metrics import TaskMetrics
from col3d.metrics.measure import NONE, Options
from col3d.runs.trained import DEPTH_SEEN, depth_seen
from col3d.training.parameter_groups import OptimizerFactory
from col3d.training.schedulers import SchedulerFactory
from col3d.training.tasks.epoch_totals import EpochTotals

EPOCH = "epoch_so_far"
"""Key of the sums of the current epoch in checkpoints."""


class SupervisedTask(LightningModule):
    """Training by one optimiser and a weighted sum of losses; validation by per-frame metrics.

    Args:
        network: (image, rays) -> `Prediction`.
        loss: (prediction, batch, epoch) -> terms by name and `total`; None if nothing is trained.
        optimizer: network -> optimiser.
        scheduler: (optimiser, steps of the schedule, epochs of the training) -> learning-rate schedule.
        interval: how often the schedule is stepped, after each "step" or "epoch".
        monitor: the metric that the schedule monitors, if it monitors one.
        options: plain options of the training, saved in checkpoints.
        metrics: options of metrics by name, for validation.
        seed: seed of random layers, which are reseeded in each step, so that a resumed training draws the
            same numbers as an uninterrupted one.
    """

    depth_seen: Tensor
    """Sum of the training depths in mm, and their number. No buffer: averages of weights include buffers."""
    _seen: Tensor
    """The same for the current epoch."""

    def __init__(
        self,
        network: nn.Module,
        loss: nn.Module | None = None,
        optimizer: OptimizerFactory | None = None,
        scheduler: SchedulerFactory | None = None,
        options: Mapping[str, Any] | None = None,
        metrics: Options = NONE,
        seed: int = 0,
        interval: str = "step",
        monitor: str | None = None,
    ) -> None:
        super().__init__()
        self.save_hyperparameters({"options": dict(options or {})}, logger=False)
        self.network, self.loss = network, loss
        self.optimizer, self.scheduler = optimizer, scheduler
        self.interval, self.monitor = interval, monitor
        self.seed = seed
        measured = {task: TaskMetrics(task, metrics) for task in measured_tasks(network)}
        self.val_metrics: dict[str, TaskMetrics] = nn.ModuleDict(measured)  # type: ignore[assignment]
        losses = _named(dict.fromkeys([*getattr(loss, "terms", ()), "total"], torch.zeros(())))
        means = {name: MeanMetric(nan_strategy="disable") for name in losses}
        self.val_losses: dict[str, MeanMetric] = nn.ModuleDict(means)  # type: ignore[assignment]
        self.last_terms: dict[str, Tensor] = {}
        self.totals = EpochTotals()
        self.depth_seen = torch.zeros(2, dtype=torch.float64)

    def forward(self, batch: Batch) -> Prediction:
        """Predict the frames of a batch."""
        prediction: Prediction = self.network(batch["image"], batch["rays"])
        check_prediction(prediction, batch["image"], type(self.network).__name__)
        return prediction

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Compute the weighted sum of the losses; log every term."""
        return self.losses(self(batch), batch)["total"]

    def losses(self, prediction: Prediction, batch: Batch) -> dict[str, Tensor]:
        """Compute the terms and their `total` for a training batch, and log them."""
        losses: dict[str, Tensor] = self._losses(prediction, batch)
        self.last_terms = {name: value.detach() for name, value in losses.items() if name != "total"}
        rate = batch["depth"].new_full((), self.trainer.optimizers[0].param_groups[0]["lr"])
        self.log_train({**_named(losses), "lr": rate}, batch)
        self.totals.count("train/frames_without_truth", (~batch["mask"].flatten(1).any(dim=1)).sum())
        if self.current_epoch == 0:
            seen = torch.where(batch["mask"], batch["depth"], 0.0).sum(dtype=torch.float64)
            self._seen = self._seen + torch.stack([seen, batch["mask"].sum()])
        return losses

    def log_train(self, values: Mapping[str, Tensor], batch: Batch) -> None:
        """Add a training batch's values to the epoch's means."""
        named = {f"train/{name}": value for name, value in values.items()}
        self.totals.add(named, weight=len(batch["image"]))

    def _losses(self, prediction: Prediction, batch: Batch) -> dict[str, Tensor]:
        if self.loss is None:
            raise RuntimeError("a task without a loss can be neither trained nor validated")
        losses: dict[str, Tensor] = self.loss(prediction, batch, self.current_epoch)
        return losses

    def on_train_epoch_start(self) -> None:
        """Reset the means of the epoch, including that of the depth."""
        self.totals.reset()
        self._seen = torch.zeros_like(self.depth_seen, device=self.device)

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Seed each step: Lightning's loader draws random numbers too, at other times after a resumption."""
        place = f"{self.seed}/{self.current_epoch}/{batch_idx}/{self.global_rank}"
        torch.manual_seed(zlib.crc32(place.encode()))

    def on_train_epoch_end(self) -> None:
        """Store the sum of training depths over all processes, and step schedules that monitor a metric."""
        if self.current_epoch == 0:
            self.depth_seen = self._sum(self._seen).cpu()
        if self._validated:
            self._watch()
        else:
            self.log_dict(self.totals.compute(self._sum), sync_dist=True)

    @property
    def _validated(self) -> bool:
        """Whether the current epoch is validated."""
        return (self.current_epoch + 1) % (self.trainer.check_val_every_n_epoch or 1) == 0

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Save the sum of training depths, and the sums of the current epoch, over all processes."""
        checkpoint[DEPTH_SEEN] = self.depth_seen.clone()
        checkpoint[EPOCH] = {
            "totals": self.totals.state(self._sum),
            "depth_seen": self._sum(self._seen).cpu(),
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Restore these sums."""
        self.depth_seen = depth_seen(checkpoint)
        checkpoint["state_dict"].pop(DEPTH_SEEN, None)
        kept, first = checkpoint[EPOCH], self.global_rank == 0
        self.totals.load(kept["totals"], first, self.device)
        self._seen = kept["depth_seen"].to(self.device) * first

    def _sum(self, values: Tensor) -> Tensor:
        """Sum values over all processes."""
        total: Tensor = self.trainer.strategy.reduce(values.clone(), reduce_op="sum")
        return total

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Update losses and metrics."""
        prediction = self(batch)
        for name, value in _named(self._losses(prediction, batch)).items():
            self.val_losses[name].update(value, weight=len(batch["image"]))
        for key, metric in self.val_metrics.items():
            if key in batch:
                mask = normals_mask(batch) if key == "normals" else batch["mask"]
                metric.update(prediction[key], batch[key], mask)  # type: ignore[literal-required]

    def on_validation_epoch_end(self) -> None:
        """Log the means over frames, and those of the training epoch, over all processes."""
        self.log_dict(self.totals.compute(self._sum), sync_dist=True)
        values = {name: metric.compute() for name, metric in self.val_losses.items()}
        for metric in self.val_metrics.values():
            means = metric.compute()
            if metric.frames > 0:
                lacking = {n for n, mean in means.items() if n in metric.undefined and mean.isnan()}
                values |= {name: mean for name, mean in means.items() if name not in lacking}
            metric.reset()
        for loss in self.val_losses.values():
            loss.reset()
        self.log_dict({f"val/{name}": value.float() for name, value in values.items()}, sync_dist=True)

    def configure_optimizers(self) -> Any:
        """Build the optimiser, with a schedule over the steps of the whole training."""
        if self.optimizer is None:
            return None
        return self._optimisation(self.optimizer, self.network)

    def _optimisation(self, optimizer: OptimizerFactory, network: nn.Module) -> dict[str, Any]:
        built = optimizer(network)
        if self.scheduler is None:
            return {"optimizer": built}
        epochs = self.trainer.max_epochs or 1
        per_step = self.interval == "step"
        steps = int(self.trainer.estimated_stepping_batches) if per_step else epochs
        schedule = self.scheduler(built, steps, epochs)
        if schedule is None:
            return {"optimizer": built}
        _check_length(schedule, steps)
        watched = {} if self.monitor is None else {"monitor": self.monitor, "strict": False}
        how = {"scheduler": schedule, "interval": self.interval, **watched}
        return {"optimizer": built, "lr_scheduler": how}

    def lr_scheduler_step(self, scheduler: Any, metric: Any | None) -> None:
        """Step a schedule; `_watch` steps one that monitors a metric, before the epoch is saved."""
        if not isinstance(scheduler, ReduceLROnPlateau):
            scheduler.step()

    def _watch(self) -> None:
        """Step schedules that monitor a metric.

        Lightning would step them only after it has saved the epoch, so that a resumed training would miss it.
        """
        for config in self.trainer.lr_scheduler_configs:
            if isinstance(config.scheduler, ReduceLROnPlateau):
                config.scheduler.step(self.trainer.callback_metrics[str(self.monitor)])


def _check_length(schedule: LRScheduler, steps: int) -> None:
    """Refuse a schedule that ends before the training, which torch would report only when it happens.

    Raises:
        UserError: names the option.
    """
    if isinstance(schedule, OneCycleLR) and schedule.total_steps < steps:
        raise UserError(
            f"scheduler.total_steps: expected at least the {steps} of this training, got "
            f"{schedule.total_steps}; left out, it is as long as the training"
        )


def _named(losses: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Rename terms to `loss_<term>`, and their weighted sum to `loss`."""
    return {"loss" if name == "total" else f"loss_{name}": value for name, value in losses.items()}

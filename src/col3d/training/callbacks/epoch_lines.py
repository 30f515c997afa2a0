"""Callback that prints a line for each epoch, for logs and terminals without a progress bar."""

import time
from collections.abc import Callable

from lightning import Callback, LightningModule, Trainer

from col3d.metrics import registered_specs
from col3d.registry.metric_specs import OURS


class EpochLines(Callback):
    """Prints losses, the main metrics and those of plugins, the time of an epoch and the time left.

    Args:
        then: called with the number of finished epochs.
    """

    SHOWN = ("train/loss", "val/loss", "val/abs_rel", "val/delta1", "val/angle_mean")

    def __init__(self, then: Callable[[int], None] = lambda done: None) -> None:
        self.then = then

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self.start, self.first = time.monotonic(), trainer.current_epoch

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Print the line on the first process."""
        metrics = trainer.callback_metrics  # reading them is a collective operation of all processes
        if not trainer.is_global_zero:
            return
        done, last = trainer.current_epoch + 1, trainer.max_epochs or 0
        pace = (time.monotonic() - self.start) / (done - self.first)
        others = [f"val/{name}" for name in registered_specs(validation=True) if name not in OURS]
        known = [name for name in (*self.SHOWN, *others) if name in metrics]
        values = "  ".join(f"{name} {metrics[name].item():.4f}" for name in known)
        print(
            f"epoch {done}/{last}  {values}  {pace:.1f} s an epoch, {pace * (last - done):.0f} s left",
            flush=True,
        )
        self.then(done)

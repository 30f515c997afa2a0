"""Callback that stops a training when numbers are not finite, before they reach weights and checkpoints."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor
from torch.optim import Optimizer

from col3d.errors import DivergedError
from col3d.io.atomic import whole_file

BAD_BATCH = "bad_batch.pt"


class FiniteNumbers(Callback):
    """Checks every loss before it is differentiated, and every gradient before the optimiser uses it.

    The offending batch is saved as `bad_batch.pt`, plain tensors and values that `torch.load(...,
    weights_only=True)` opens: its tensors, videos and frames, the terms of the loss, and the reason.

    Args:
        folder: folder for that file; None writes none.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder
        self.batch: Any = {}

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Remember the batch of the step."""
        self.batch = batch

    def on_before_backward(self, trainer: Trainer, pl_module: LightningModule, loss: Tensor) -> None:
        """Refuse a loss that is not finite.

        Raises:
            DivergedError: names the step, the frames and the term.
        """
        if not torch.isfinite(loss):
            terms = {name: value.item() for name, value in getattr(pl_module, "last_terms", {}).items()}
            bad = [f"loss_{name}" for name, value in terms.items() if not math.isfinite(value)]
            causes = f", because of {', '.join(bad)}" if bad else ""
            self._stop(trainer, f"the loss is {loss.item()}{causes}", terms)

    def on_before_optimizer_step(
        self, trainer: Trainer, pl_module: LightningModule, optimizer: Optimizer
    ) -> None:
        """Refuse a gradient that is not finite; in float16 the gradient scaler skips such steps by itself.

        Raises:
            DivergedError: names the step, the frames and the parameter.
        """
        learned = [p for group in optimizer.param_groups for p in group["params"] if p.grad is not None]
        if trainer.precision == "16-mixed" or not learned:
            return
        if not torch.nn.utils.get_total_norm([p.grad for p in learned if p.grad is not None]).isfinite():
            names = [n for n, p in pl_module.named_parameters() if p.grad is not None and not _finite(p.grad)]
            if names:  # otherwise only the sum of squares overflows float32
                self._stop(trainer, f"the gradient of {names[0]} is not finite", {})

    def _stop(self, trainer: Trainer, reason: str, terms: Mapping[str, float]) -> None:
        step = trainer.fit_loop.total_batch_idx
        pairs = zip(self.batch["video"], self.batch["frame"].tolist(), strict=True)
        frames = ", ".join(f"{video}:{frame}" for video, frame in pairs)
        kept = ""
        if self.folder is not None:
            self._keep(self.folder / BAD_BATCH, trainer, step, reason, terms)
            kept = f"; {self.folder / BAD_BATCH} has them"
        raise DivergedError(
            f"{reason} at step {step} (frames {frames}{kept}); lower optimizer.lr, set "
            "trainer.gradient_clip, or look at these frames"
        )

    def _keep(self, path: Path, trainer: Trainer, step: int, reason: str, terms: Mapping[str, float]) -> None:
        batch = {k: v.detach().cpu() if isinstance(v, Tensor) else list(v) for k, v in self.batch.items()}
        facts = {"epoch": trainer.current_epoch, "step": step, "reason": reason, "terms": dict(terms)}
        with whole_file(path, f"-{trainer.global_rank}") as file:
            torch.save({**facts, "batch": batch}, file)


def _finite(values: Tensor) -> bool:
    return bool(values.isfinite().all())

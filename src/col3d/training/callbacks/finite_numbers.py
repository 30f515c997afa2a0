"""Stops a training whose numbers are no longer finite, before they spoil weights and checkpoints."""

import math
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor
from torch.nn.utils import get_total_norm
from torch.optim import Optimizer

from col3d.errors import DivergedError
from col3d.io.atomic import whole_file

BAD_BATCH = "bad_batch.pt"
LATE = 2
"""Steps after which the host reads, at the latest, what a GPU found."""


@dataclass
class _Check:
    """A loss or a gradient, and whether it is finite.

    Attributes:
        step: counted from the beginning of the training.
        epoch: of the step.
        batch: that the step is about.
        loss: its value; None where a gradient is checked.
        terms: of the loss.
        finite: on the host, once `arrived` has passed.
        arrived: passes when the device has got there; None where it computes at once.
    """

    step: int
    epoch: int
    batch: Any
    loss: Tensor | None
    terms: dict[str, Tensor]
    finite: Tensor
    arrived: torch.cuda.Event | None

    def is_finite(self) -> bool:
        """Wait for the device and read."""
        if self.arrived is not None:
            self.arrived.synchronize()
        return bool(self.finite)


class FiniteNumbers(Callback):
    """Checks the loss before it is differentiated, and the gradient before the optimiser uses it.

    On a GPU the host does not wait for either: it reads the outcome when the device has got there, `LATE`
    steps later at most and before anything is validated or saved. The weights in memory are spoiled by then,
    those of the last checkpoint are not.

    The batch in question is kept as `bad_batch.pt`, plain tensors and values that `torch.load(...,
    weights_only=True)` opens: its tensors, videos and frames, the terms of the loss, and why.

    Args:
        folder: where that file goes; nowhere when absent.
        late: steps that the host may be ahead of the check; `LATE` on a GPU and 0 elsewhere when absent.
    """

    def __init__(self, folder: Path | None = None, late: int | None = None) -> None:
        self.folder, self.late = folder, late
        self.batch: Any = {}
        self.checks: deque[_Check] = deque()

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Remember what the step is about, and read the checks of earlier ones."""
        self.batch = batch
        oldest = trainer.fit_loop.total_batch_idx - (LATE if self.late is None else self.late)
        while self.checks and (_has_arrived(self.checks[0]) or self.checks[0].step < oldest):
            self._read(trainer, pl_module)

    def on_before_backward(self, trainer: Trainer, pl_module: LightningModule, loss: Tensor) -> None:
        """Refuse a loss that is not finite.

        Raises:
            DivergedError: names the step, the frames and the term.
        """
        self._check(trainer, pl_module, loss.detach(), loss.detach().isfinite())

    def on_before_optimizer_step(
        self, trainer: Trainer, pl_module: LightningModule, optimizer: Optimizer
    ) -> None:
        """Refuse a gradient that is not finite; in float16 the scaler leaves such steps out by itself.

        Raises:
            DivergedError: names the step, the frames and, where the host did not run ahead, the parameter.
        """
        gradients = [
            p.grad for group in optimizer.param_groups for p in group["params"] if p.grad is not None
        ]
        if gradients and trainer.precision != "16-mixed":
            largest = get_total_norm(gradients, norm_type=math.inf)  # a sum of squares may overflow
            self._check(trainer, pl_module, None, largest.isfinite())

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Read what is left before anything is validated."""
        self._read_all(trainer, pl_module)

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Read what is left before anything is saved."""
        self._read_all(trainer, pl_module)

    def _check(
        self, trainer: Trainer, pl_module: LightningModule, loss: Tensor | None, finite: Tensor
    ) -> None:
        step, epoch, arrived = trainer.fit_loop.total_batch_idx, trainer.current_epoch, None
        if finite.is_cuda:
            there = torch.empty(finite.shape, dtype=finite.dtype, pin_memory=True)
            finite = there.copy_(finite, non_blocking=True)
            arrived = torch.cuda.Event()
            arrived.record()
        terms = dict(getattr(pl_module, "last_terms", {}))
        self.checks.append(_Check(step, epoch, self.batch, loss, terms, finite, arrived))
        if self.late == 0 or (self.late is None and arrived is None):
            self._read_all(trainer, pl_module)

    def _read_all(self, trainer: Trainer, pl_module: LightningModule) -> None:
        while self.checks:
            self._read(trainer, pl_module)

    def _read(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Read the oldest check.

        Raises:
            DivergedError: it is bad news.
        """
        check = self.checks.popleft()
        if check.is_finite():
            return
        self.checks.clear()  # what came after follows from it
        terms = {name: value.item() for name, value in check.terms.items()}
        if check.loss is None:
            at_once = check.step == trainer.fit_loop.total_batch_idx
            reason = f"the gradient{_of_whom(pl_module) if at_once else ''} is not finite"
        else:
            bad = [f"loss_{name}" for name, value in terms.items() if not math.isfinite(value)]
            of_them = f", because of {', '.join(bad)}" if bad else ""
            reason = f"the loss is {check.loss.item()}{of_them}"
        pairs = zip(check.batch["video"], check.batch["frame"].tolist(), strict=True)
        frames = ", ".join(f"{video}:{frame}" for video, frame in pairs)
        kept = ""
        if self.folder is not None:
            self._keep(self.folder / BAD_BATCH, trainer, check, reason, terms)
            kept = f"; {self.folder / BAD_BATCH} has them"
        raise DivergedError(
            f"{reason} at step {check.step} (frames {frames}{kept}); lower optimizer.lr, set "
            "trainer.gradient_clip, or look at these frames"
        )

    def _keep(
        self, path: Path, trainer: Trainer, check: _Check, reason: str, terms: dict[str, float]
    ) -> None:
        batch = {k: v.detach().cpu() if isinstance(v, Tensor) else list(v) for k, v in check.batch.items()}
        facts = {"epoch": check.epoch, "step": check.step, "reason": reason, "terms": terms}
        with whole_file(path, f"-{trainer.global_rank}") as file:
            torch.save({**facts, "batch": batch}, file)


def _has_arrived(check: _Check) -> bool:
    return check.arrived is not None and check.arrived.query()


def _of_whom(module: LightningModule) -> str:
    """The first parameter whose gradient is not finite."""
    bad = (n for n, p in module.named_parameters() if p.grad is not None and not p.grad.isfinite().all())
    return f" of {name}" if (name := next(bad, None)) else ""

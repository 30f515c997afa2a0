"""Adversarial training against a discriminator that learns to tell predicted from true depth."""

from typing import Any

import torch
from jaxtyping import Float
from lightning.pytorch.core.optimizer import LightningOptimizer
from torch import Tensor, nn

from col3d.batch import Batch, Prediction
from col3d.losses import gan_loss
from col3d.training.tasks.supervised import SupervisedTask


class AdversarialTask(SupervisedTask):
    """Supervised losses and an adversarial loss, with two optimisers in turn.

    Each batch first trains the discriminator, with half its loss, and then the network. The discriminator
    sees image and depth in [-1, 1]; unknown depth is 0 mm in both kinds of pairs and so gives nothing away.

    Args:
        arguments: positional arguments of `SupervisedTask`.
        discriminator: (b, 4, h, w) of image and depth -> logits.
        max_depth: depth in mm that is mapped to 1.
        weight: weight of the adversarial term in the network's loss.
        gradient_clip: the largest norm of either gradient, or None.
        options: keyword arguments of `SupervisedTask`.

    References:
        Isola et al.: Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017, section 3.
    """

    def __init__(
        self,
        *arguments: Any,
        discriminator: nn.Module,
        max_depth: float,
        weight: float = 1.0,
        gradient_clip: float | None = None,
        **options: Any,
    ) -> None:
        super().__init__(*arguments, **options)
        self.automatic_optimization = False
        self.discriminator = discriminator
        self.max_depth, self.weight, self.gradient_clip = max_depth, weight, gradient_clip

    def training_step(self, batch: Batch, batch_idx: int) -> None:  # type: ignore[override]
        """Take a step of the discriminator and one of the network; log every term."""
        generating, discriminating = self.optimizers()  # type: ignore[attr-defined]
        prediction = self(batch)
        taught = self._teach(discriminating, prediction, batch)
        self.toggle_optimizer(generating)
        adversarial = gan_loss(self.discriminator(self._pair(batch, prediction["depth"])), real=True)
        total = self.losses(prediction, batch)["total"] + self.weight * adversarial
        self._step(generating, total)
        self.untoggle_optimizer(generating)
        self.log_train({"loss_adversarial": adversarial, "loss_discriminator": taught}, batch)
        for config in self.trainer.lr_scheduler_configs:
            if config.interval == "step" or self.trainer.is_last_batch:
                config.scheduler.step()  # type: ignore[call-arg]

    def _teach(self, optimizer: LightningOptimizer, prediction: Prediction, batch: Batch) -> Tensor:
        self.toggle_optimizer(optimizer)
        fake = gan_loss(self.discriminator(self._pair(batch, prediction["depth"].detach())), real=False)
        real = gan_loss(self.discriminator(self._pair(batch, batch["depth"])), real=True)
        loss = (fake + real) / 2
        self._step(optimizer, loss)
        self.untoggle_optimizer(optimizer)
        return loss

    def _step(self, optimizer: LightningOptimizer, loss: Tensor) -> None:
        optimizer.zero_grad()
        self.manual_backward(loss)
        if self.gradient_clip is not None:
            self.clip_gradients(optimizer.optimizer, self.gradient_clip, gradient_clip_algorithm="norm")
        optimizer.step()

    def _pair(self, batch: Batch, depth: Tensor) -> Float[Tensor, "b 4 h w"]:
        known = torch.where(batch["mask"], depth, 0.0)
        return torch.cat([2 * batch["image"] - 1, 2 * known / self.max_depth - 1], dim=1)

    def configure_optimizers(self) -> Any:
        """Use the same kind of optimiser and schedule for the network and the discriminator."""
        if self.optimizer is None:
            return None
        return [self._optimisation(self.optimizer, net) for net in (self.network, self.discriminator)]

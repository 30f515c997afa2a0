"""The smallest networks that learn against each other; as a program, two processes train them together."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, Trainer
from torch import Tensor, nn
from torch.optim.lr_scheduler import LambdaLR
from torch.utils.data import DataLoader, DistributedSampler

from col3d.batch import Prediction
from col3d.losses import WeightedLoss
from col3d.training.tasks import AdversarialTask

MAX_DEPTH = 100.0
QUIET: dict[str, Any] = {
    "accelerator": "cpu",
    "logger": False,
    "enable_checkpointing": False,
    "enable_progress_bar": False,
    "enable_model_summary": False,
    "num_sanity_val_steps": 0,
}
LOSS = WeightedLoss([100.0], {"depth": "depth_l1"}, max_depth=MAX_DEPTH)


class TinyNetwork(nn.Module):
    """A depth for each pixel."""

    def __init__(self, dropout: float) -> None:
        super().__init__()
        first, last = nn.Conv2d(3, 8, 3, padding=1), nn.Conv2d(8, 1, 3, padding=1)
        self.layers = nn.Sequential(first, nn.ReLU(), nn.Dropout(dropout), last)

    def forward(self, image: Tensor, rays: Tensor) -> Prediction:
        return {"depth": MAX_DEPTH * self.layers(image).sigmoid()}


def tiny_critic() -> nn.Module:
    """A discriminator without batch norm, for which a batch is the mean of its frames."""
    first, last = nn.Conv2d(4, 8, 4, stride=2, padding=1), nn.Conv2d(8, 1, 3, padding=1)
    return nn.Sequential(first, nn.LeakyReLU(0.2), last)


def frames(count: int = 4) -> list[dict[str, Any]]:
    """Noise; the upper rows are unknown and hold what nobody should look at."""
    generator = torch.Generator().manual_seed(0)
    mask = torch.ones(1, 32, 32, dtype=torch.bool)
    mask[:, :7] = False
    return [
        {
            "image": torch.rand(3, 32, 32, generator=generator),
            "depth": torch.where(mask, 90 * torch.rand(1, 32, 32, generator=generator) + 5, 999.0),
            "mask": mask,
            "rays": torch.zeros(3, 32, 32),
            "video": "a",
            "frame": number,
        }
        for number in range(count)
    ]


def adam(network: nn.Module) -> torch.optim.Optimizer:
    return torch.optim.Adam(network.parameters(), lr=1e-2, betas=(0.5, 0.999))


def halved_every_third_step(optimizer: Any, steps: int, epochs: int) -> Any:
    return LambdaLR(optimizer, lambda step: 0.5 ** (step // 3))


def tiny_task(
    critic: Callable[[], nn.Module] = tiny_critic, dropout: float = 0.0, **options: Any
) -> AdversarialTask:
    """The same weights each time."""
    torch.manual_seed(0)
    network, discriminator = TinyNetwork(dropout), critic()
    given = {"optimizer": adam, "scheduler": halved_every_third_step, "weight": 2.0, **options}
    return AdversarialTask(network, LOSS, discriminator=discriminator, max_depth=MAX_DEPTH, **given)


def fit(
    task: AdversarialTask,
    *callbacks: Callback,
    batch_size: int = 2,
    ckpt_path: Path | None = None,
    sampler: DistributedSampler[Any] | None = None,
    **options: Any,
) -> Trainer:
    trainer = Trainer(**QUIET | {"max_epochs": 1, "callbacks": list(callbacks)} | options)
    loader: DataLoader[Any] = DataLoader(frames(), batch_size=batch_size, sampler=sampler)  # type: ignore[arg-type]
    trainer.fit(task, loader, loader, ckpt_path=ckpt_path, weights_only=True)
    return trainer


if __name__ == "__main__":
    task, rank = tiny_task(), int(os.environ.get("LOCAL_RANK", "0"))
    in_turn: DistributedSampler[Any] = DistributedSampler(frames(), 2, rank, shuffle=False)  # type: ignore[arg-type]
    ddp: dict[str, Any] = {
        "devices": 2,
        "strategy": "ddp_find_unused_parameters_true",
        "use_distributed_sampler": False,
    }
    trainer = fit(task, batch_size=1, sampler=in_turn, **ddp)
    if trainer.is_global_zero:
        torch.save(task.state_dict(), sys.argv[1])

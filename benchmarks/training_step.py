"""What augmentation adds to a training step at preset=laptop."""

from functools import partial

import torch

from benchmarks.loading import our_batch, wait_for
from benchmarks.options import train_options
from benchmarks.timing import Work, interleaved
from col3d.batch import Batch
from col3d.data.datasets.frame_set import FrameSet
from col3d.data.sized import Resized
from col3d.data.transforms import Augment, draws_of
from col3d.training.build import build_task
from col3d.training.options import TrainOptions

STEP = "step without augmentation"
AUGMENTS = {
    "augmentation as it is (rotation)": Augment(),
    "augmentation with all on": Augment(rotation=1.0, flip=0.5, crop=0.9, jitter=0.5),
}


def laptop_options(*overrides: str) -> TrainOptions:
    """What `train.py model=col3d_mtl preset=laptop` takes."""
    return train_options("model=col3d_mtl", "preset=laptop", *overrides)


def step_costs(
    frames: FrameSet, options: TrainOptions, device: torch.device, repeats: int
) -> dict[str, list[float]]:
    """Milliseconds of a step, and of each augmentation of its batch, for each repeat."""
    height, width = options.data.size
    batch = our_batch(Resized(frames, (height, width)), options.data.batch_size, device)
    works = {STEP: training_step(options, batch, device)}
    for name, augment in AUGMENTS.items():
        works[name] = partial(_augment, augment, batch, device)
    seconds = interleaved(works, repeats)
    return {name: [1000 * second for second in taken] for name, taken in seconds.items()}


def training_step(options: TrainOptions, batch: Batch, device: torch.device) -> Work:
    """Forward, losses, backward and optimiser on one batch."""
    task = build_task(options).to(device)
    assert task.optimizer is not None
    assert task.loss is not None
    network, losses, optimizer = task.network, task.loss, task.optimizer(task.network)

    def step() -> None:
        optimizer.zero_grad()
        losses(network(batch["image"], batch["rays"]), batch, 0)["total"].backward()
        optimizer.step()
        wait_for(device)

    return step


def _augment(augment: Augment, batch: Batch, device: torch.device) -> None:
    augment(batch, draws_of(batch, seed=0, epoch=0).to(device))
    wait_for(device)

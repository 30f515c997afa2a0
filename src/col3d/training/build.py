"""Construction of a task from checked options: network, loss and optimisation."""

import functools
from collections.abc import Callable

from col3d.errors import OptionError, UserError
from col3d.layers.freeze import check_learns
from col3d.layers.patch_gan import PatchGAN
from col3d.losses import WeightedLoss
from col3d.losses.options import balancer
from col3d.models.build import build_network
from col3d.training.optimizers import check_encoder, optimizer_of
from col3d.training.options import AdversarialOptions, TrainOptions
from col3d.training.schedulers import interval_of, scheduler_of
from col3d.training.tasks import AdversarialTask, SupervisedTask


def build_task(options: TrainOptions) -> SupervisedTask:
    """Build the task of a training: network, loss and optimisation.

    Raises:
        UserError: the encoder or its weights are not available, or parts do not fit together.
    """
    kind: Callable[..., SupervisedTask] = SupervisedTask
    if isinstance(options.task, AdversarialOptions):
        kind = functools.partial(
            AdversarialTask,
            discriminator=PatchGAN(width=options.task.discriminator_width),
            max_depth=options.model.max_depth,
            weight=options.task.weight,
            gradient_clip=options.trainer.gradient_clip,
        )
    height, width = options.data.size
    net = build_network(options.model, (height, width))
    try:
        check_encoder(options.optimizer, net)
        check_learns(net)
    except OptionError as error:
        raise UserError(str(error)) from None
    return kind(
        net,
        WeightedLoss(
            options.loss.lambdas,
            options.loss.terms,
            options.model.max_depth,
            balancer(options.loss.balance),
        ),
        optimizer_of(options.optimizer),
        scheduler_of(options.scheduler),
        options.model_dump(mode="json"),
        interval=interval_of(options.scheduler),
        monitor=getattr(options.scheduler, "monitor", None),
        metrics=options.metrics,
        seed=options.seed,
    )

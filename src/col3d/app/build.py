"""Checked options -> objects."""

import functools
from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

from torch import nn

from col3d.app.config import AdversarialOptions, ProtocolOptions, TrainOptions
from col3d.checks import OptionError, UserError
from col3d.layers.freeze import check_learns, freeze, thaw
from col3d.layers.patch_gan import PatchGAN
from col3d.layers.weight_file import check_finite, check_fractions
from col3d.losses import WeightedLoss
from col3d.losses.options import balancer
from col3d.metrics import Protocol
from col3d.models import create
from col3d.models.options import ModelOptions
from col3d.optimizers import check_encoder, optimizer_of
from col3d.registry import MODELS
from col3d.schedulers import interval_of, scheduler_of
from col3d.tasks import AdversarialTask, SupervisedTask
from col3d.tasks.supervised import DEPTH_SEEN


def network(options: ModelOptions, size_hw: tuple[int, int]) -> nn.Module:
    """The network, with its weights to start from and its frozen parts.

    Raises:
        UserError: the encoder or its weights are not to be had, or parts do not fit. Other errors of the
            network's own code are left as they are.
    """
    given = options.model_dump(exclude={"freeze", "unfreeze_at"})
    if "size_hw" in signature(MODELS[options.name].build).parameters:
        given["size_hw"] = size_hw
    try:
        built = create(**given)
        freeze(built, options.freeze)
        if options.unfreeze_at is not None:
            thaw(built, options.freeze)
    except OptionError as error:
        raise UserError(str(error)) from None
    return built


def task(options: TrainOptions) -> SupervisedTask:
    """Network, loss and optimisation.

    Raises:
        UserError: the encoder or its weights are not to be had, or parts do not fit.
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
    net = network(options.model, (height, width))
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
        protocol=protocol(*options.one_protocol),
        mirror=options.one_protocol[1].mirror,
        seed=options.seed,
    )


def protocol(name: str, options: ProtocolOptions) -> Protocol:
    """What predictions are scored by."""
    low, high = options.truth_range
    return Protocol(name, options.scaling, (low, high), options.cosine_epsilon, options.normal_axes)


def fill_network(built: SupervisedTask, content: Mapping[str, Any], checkpoint: Path) -> None:
    """Load the network that a checkpoint of ours holds, and the mean depth of its training.

    Raises:
        UserError: its tensors are not finite, or not those of the network.
    """
    state = content.get("state_dict")
    if isinstance(state, Mapping):
        ours = {k: v for k, v in state.items() if str(k).startswith("network.") or k == DEPTH_SEEN}
        content = {**content, "state_dict": ours}
    fill(built, content, checkpoint)


def fill(built: SupervisedTask, content: Mapping[str, Any], checkpoint: Path) -> int:
    """Load what a checkpoint of ours holds into a task.

    Returns:
        The epoch it is of.

    Raises:
        UserError: its tensors are not finite, or not those of the task.
    """
    try:
        content = {**content, "state_dict": dict(content["state_dict"])}
        check_finite(content["state_dict"])
        built.take_depth_seen(content)
        check_fractions(content["state_dict"], built.state_dict())
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise UserError(f"checkpoint: {checkpoint}: {' '.join(str(error).split())}") from None
    try:
        built.load_state_dict(content["state_dict"])
        return int(content["epoch"])
    except (KeyError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"checkpoint: {checkpoint} does not fit its own options: {reason[:300]}") from None

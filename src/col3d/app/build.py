"""Checked options -> objects."""

import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.optim import SGD, Adam, AdamW, Optimizer

from col3d.app.config import (
    AdamOptions,
    AdversarialOptions,
    ConstantOptions,
    DataOptions,
    ModelOptions,
    OptimizerOptions,
    PhantomOptions,
    PolynomialOptions,
    ProtocolOptions,
    SchedulerOptions,
    StepOptions,
    TrainOptions,
)
from col3d.checks import DataError, UserError
from col3d.data.c3vd import C3VD, video_folders
from col3d.data.datamodule import FrameDataModule, Resized
from col3d.data.phantom import PhantomSettings, phantom_camera, render_phantom
from col3d.data.splits import SPLITS, check_counts, paper_split, parse_selection, video_table
from col3d.data.transforms import Augment, Resize
from col3d.geometry import Camera, OmnidirectionalCamera
from col3d.layers.freeze import freeze
from col3d.layers.network import DepthNetwork
from col3d.layers.patch_gan import PatchGAN
from col3d.losses import WeightedLoss
from col3d.metrics import Protocol
from col3d.models import create
from col3d.tasks import AdversarialTask, SupervisedTask
from col3d.tasks.optimisation import (
    OptimizerFactory,
    SchedulerFactory,
    parameter_groups,
    polynomial_decay,
    step_decay,
)


def phantom_settings(options: PhantomOptions, videos: Iterable[str] | None = None) -> PhantomSettings:
    """What is asked to be rendered: these videos, or all."""
    height, width = options.size
    return PhantomSettings(
        size_hw=(height, width),
        frames_per_video=options.frames_per_video,
        seed=options.seed,
        videos=tuple(video_table() if videos is None else videos),
    )


def with_absolute_root(options: TrainOptions) -> TrainOptions:
    """The options with a data.root that holds from any folder."""
    data = options.data.model_copy(update={"root": str(Path(options.data.root).absolute())})
    return options.model_copy(update={"data": data})


def camera(options: DataOptions, phantom: PhantomOptions) -> Camera:
    """Lens and size of the stored frames."""
    if options.name == "phantom":
        return phantom_camera(phantom_settings(phantom))
    return OmnidirectionalCamera.c3vd()


def frame_sets(
    options: DataOptions, phantom: PhantomOptions, splits: Iterable[str] = SPLITS
) -> dict[str, C3VD]:
    """The frames of each part of the split at full resolution; the phantom is rendered first where it is not.

    Raises:
        DataError: a video is missing, or a file is not what it should be.
    """
    root = Path(options.root)
    if options.name == "phantom":
        render_phantom(root, phantom_settings(phantom, _videos(options, splits)))
    entries = _entries_at_hand(options, root, splits)
    sets = {
        split: C3VD(root, chosen, options.release, options.normals, camera(options, phantom))
        for split, chosen in entries.items()
    }
    if options.name == "c3vd" and not options.allow_missing:
        for split, frames in sets.items():
            if entries[split] == paper_split()[split]:
                _check_paper_counts(frames)
    return sets


def _videos(options: DataOptions, splits: Iterable[str]) -> list[str]:
    entries = [entry for split in splits for entry in getattr(options.split, split)]
    return sorted({parse_selection(entry).video for entry in entries})


def _entries_at_hand(options: DataOptions, root: Path, splits: Iterable[str]) -> dict[str, list[str]]:
    """Entries of the split, without those of missing videos where that is allowed."""
    present = video_folders(root)
    entries: dict[str, list[str]] = {}
    missing: list[str] = []
    for split in splits:
        named = {entry: parse_selection(entry, present).video for entry in getattr(options.split, split)}
        missing += [video for video in named.values() if video not in present and video not in missing]
        entries[split] = [entry for entry, video in named.items() if video in present]
    if missing and not options.allow_missing:
        raise DataError(
            f"data.root={root}: videos {', '.join(missing)} of split {options.split.name} are missing; copy "
            "them there, name other videos in data.split, or set data.allow_missing=true to leave them out"
        )
    for split, chosen in entries.items():
        if not chosen:
            raise DataError(f"data.root={root}: no video of data.split.{split} is there")
    if missing:
        print(f"note: left out, because data.allow_missing=true: {', '.join(missing)}", flush=True)
    return entries


def _check_paper_counts(frames: C3VD) -> None:
    counts: dict[str, int] = {}
    for frame in frames.frames:
        counts[frame.video] = counts.get(frame.video, 0) + 1
    for release in set(frames.releases.values()):
        check_counts({v: n for v, n in counts.items() if frames.releases[v] == release}, release)


def resized(frames: C3VD, options: DataOptions, phantom: PhantomOptions, truth: str = "clean") -> Resized:
    """Frames at the network's size; `truth` as in `Resize`."""
    height, width = options.size
    return Resized(frames, Resize((height, width), camera(options, phantom), truth))


def data_module(
    options: DataOptions,
    phantom: PhantomOptions,
    seed: int,
    splits: Iterable[str] = SPLITS,
    test_truth: str = "clean",
) -> FrameDataModule:
    """Loaders of resized frames; `test_truth` says how the truth of the test split is."""
    sets = frame_sets(options, phantom, splits)
    truth = {split: test_truth if split == "test" else "clean" for split in sets}
    return FrameDataModule(
        {split: resized(frames, options, phantom, truth[split]) for split, frames in sets.items()},
        batch_size=options.batch_size,
        workers=options.workers,
        augment=Augment(**options.augment.model_dump()),
        seed=seed,
    )


def network(options: ModelOptions, size_hw: tuple[int, int]) -> DepthNetwork:
    """The network, with its weights to start from and its frozen parts.

    Raises:
        UserError: the encoder or its weights are not to be had, or parts do not fit.
    """
    given = options.model_dump(exclude={"freeze"})
    if options.name == "pix2pix":
        given["size"] = size_hw
    try:
        built = create(**given)
        freeze(built, options.freeze)
    except (ValueError, OSError, RuntimeError) as error:
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
    return kind(
        network(options.model, (height, width)),
        WeightedLoss(**options.loss.model_dump(), max_depth=options.model.max_depth),
        optimizer(options.optimizer),
        scheduler(options.scheduler),
        options.model_dump(mode="json"),
        protocol=protocol(*options.one_protocol),
        mirror=options.one_protocol[1].mirror,
        seed=options.seed,
    )


def protocol(name: str, options: ProtocolOptions) -> Protocol:
    """What predictions are scored by."""
    low, high = options.truth_range
    return Protocol(name, options.scaling, (low, high), options.cosine_epsilon, options.normal_axes)


def optimizer(options: OptimizerOptions) -> OptimizerFactory:
    """Network -> optimiser of the parameters that learn."""
    extra: dict[str, Any] = {}
    if isinstance(options, AdamOptions):
        extra = {"eps": options.eps, "betas": (options.betas[0], options.betas[1])}
    else:
        extra = {"momentum": options.momentum}
    kind: Any = {"adamw": AdamW, "adam": Adam, "sgd": SGD}[options.name]

    def build(network: nn.Module) -> Optimizer:
        groups = parameter_groups(network, options.weight_decay, options.decoder_weight_decay)
        built: Optimizer = kind(groups, lr=options.lr, **extra)
        return built

    return build


def scheduler(options: SchedulerOptions) -> SchedulerFactory | None:
    """(optimiser, steps, epochs) -> schedule, or None for a constant rate."""
    match options:
        case ConstantOptions():
            return None
        case PolynomialOptions():
            return lambda optimizer, steps, epochs: polynomial_decay(
                optimizer, steps, options.power, options.final_ratio, options.hold
            )
        case StepOptions():
            return lambda optimizer, steps, epochs: step_decay(
                optimizer, options.epochs * steps // epochs, options.factor
            )


def load_weights(built: SupervisedTask, checkpoint: Path) -> int:
    """Load a checkpoint of ours into a task, opened as weights and plain values only.

    Returns:
        The epoch it is of.

    Raises:
        UserError: its tensors are not those of the task.
    """
    return fill(built, torch.load(checkpoint, map_location="cpu", weights_only=True), checkpoint)


def fill(built: SupervisedTask, content: Mapping[str, Any], checkpoint: Path) -> int:
    """The same of a checkpoint that is read already."""
    try:
        built.load_state_dict(content["state_dict"])
        return int(content["epoch"])
    except (KeyError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"checkpoint: {checkpoint} does not fit its own options: {reason[:300]}") from None

"""A training step never makes the host wait for the device: nothing is read back, nothing plainly copied up.

The steps run on torch's meta device, which has shapes and no numbers: whatever would need one fails.
"""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import torch
from lightning import Callback, Trainer
from lightning.pytorch.accelerators import CPUAccelerator
from lightning.pytorch.strategies import SingleDeviceStrategy
from tiny_run import SMALL, TINY, composed
from torch import Tensor
from torch.overrides import TorchFunctionMode

from col3d.data.build import data_module
from col3d.registry.refusals import check_options
from col3d.training.build import build_task
from col3d.training.callbacks.finite_numbers import FiniteNumbers
from col3d.training.options import TrainOptions

META = torch.device("meta")
READS = {
    Tensor.item,
    Tensor.tolist,
    Tensor.cpu,
    Tensor.numpy,
    Tensor.__bool__,
    Tensor.__float__,
    Tensor.__int__,
}
"""What brings numbers to the host."""
COPIES = {torch.tensor, torch.as_tensor, Tensor.new_tensor}
"""What brings numbers of the host to a device, for which it waits."""
CHECKS = {torch.linalg.inv, torch.linalg.solve, torch.inverse, Tensor.inverse, torch.linalg.cholesky}
"""What reads from a GPU whether it went well."""


class Waited(AssertionError):
    """Something would make the host wait."""


class Watch(TorchFunctionMode):
    """Refuses what makes the host of a GPU wait, which the meta device alone does not."""

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        given = kwargs or {}
        made = func(*args, **given)
        on_device = isinstance(made, Tensor) and made.device == META
        if func in READS and isinstance(args[0], Tensor) and args[0].device == META:
            raise Waited(func)
        if on_device and (func in CHECKS or (func in COPIES and not isinstance(args[0], Tensor))):
            raise Waited(func)
        if on_device and func is Tensor.new_tensor:
            raise Waited(func)
        moved = func is Tensor.to and args[0].device != META and on_device
        if moved and not (given.get("non_blocking") or args[2:3] == (True,)):
            raise Waited(func, args[1:], given)
        return made


def no_autocast(*_: Any, **__: Any) -> Any:
    return nullcontext()


class Done(Exception):
    """The steps are over."""


class Shapes(CPUAccelerator):
    """The meta device in the place of a GPU."""

    def setup_device(self, device: torch.device) -> None: ...


class OneDevice(SingleDeviceStrategy):
    """Neither asks the device before the first step, nor brings its weights back after the last."""

    def reduce(self, tensor: Any, *_: Any, **__: Any) -> Any:
        return torch.ones(())  # Lightning asks whether loaders are empty

    def reduce_boolean_decision(self, decision: bool, all: bool = True) -> bool:
        return decision

    def teardown(self) -> None: ...


class SecondStep(Callback):
    """Watches from the end of the first step, which makes what is kept, to the end of the second."""

    def __init__(self) -> None:
        self.watch = Watch()

    def on_train_batch_end(self, trainer: Trainer, *_: Any) -> None:
        if trainer.fit_loop.total_batch_idx == 0:
            self.watch.__enter__()
        else:
            self.watch.__exit__(None, None, None)
            raise Done


@pytest.mark.parametrize(
    "overrides",
    [
        ["model=col3d_mtl"],
        ["model=bts"],
        ["model=bts_cbam"],
        ["model=bts_cbam_mtl"],
        ["model=monodepth_fpn"],
        ["model=newcrfs", "model.encoder=swin_tiny_patch4_window7_224"],
        ["model=pix2pix"],
        ["model=col3d_mtl", "loss=mtl_xtc", "trainer.gradient_clip=1.0"],
        ["data.augment.flip=0.5", "data.augment.crop=0.9", "data.augment.jitter=0.5"],
    ],
    ids=" ".join,
)
def test_a_training_step_reads_nothing_back(
    overrides: list[str], phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch, "autocast", no_autocast)  # of which the meta device knows nothing
    encoder = () if overrides[0] in ("model=newcrfs", "model=pix2pix") else (SMALL,)
    place = (f"data.root={phantom_root}", f"output_dir={tmp_path}")
    given = composed("train", *TINY, *place, *overrides, *encoder)
    options = check_options(TrainOptions, given)
    watched = SecondStep()
    trainer = Trainer(
        max_epochs=1,
        strategy=OneDevice(META, Shapes()),
        callbacks=[watched, FiniteNumbers(late=10)],
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        gradient_clip_val=None if options.task.name == "adversarial" else options.trainer.gradient_clip,
    )
    with pytest.raises(Done):
        trainer.fit(build_task(options), datamodule=data_module(options.data, options.phantom, options.seed))


@pytest.mark.parametrize(
    "wait",
    [
        lambda values: values.sum().item(),
        lambda values: values.tolist(),
        lambda values: bool(values[0] > 0),
        lambda values: values.new_tensor([1.0, 2.0]),
        lambda values: torch.tensor([1.0], device=values.device),
        lambda values: torch.ones(3).to(values.device),
        lambda values: torch.linalg.inv(values.expand(3, 3)),
        lambda values: values[values > 0],
        lambda values: values.nonzero(),
    ],
)
def test_what_waits_is_noticed(wait: Callable[[Tensor], Any]) -> None:
    with pytest.raises((Waited, NotImplementedError, RuntimeError)), Watch():
        wait(torch.ones(3, device=META))

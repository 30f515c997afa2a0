"""Networks as `preset=paper` trains them, and the published programs' twins, ready to be timed."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from benchmarks.gpu.setting import Mode, Setting, precision
from benchmarks.memory import peak_bytes
from benchmarks.options import train_options
from benchmarks.twins.col3d import PublishedCol3D
from benchmarks.twins.newcrfs import PublishedNeWCRFs
from col3d.batch import Batch, Prediction
from col3d.layers.network import DepthNetwork
from col3d.losses import WeightedLoss
from col3d.models import create
from col3d.models.build import build_network
from col3d.training.optimizers import optimizer_of
from col3d.training.options import TrainOptions

TWINS = ("col3d_mtl", "newcrfs")
TWIN = "published code"
OWN_FORMAT = "col3d"
ADAMW_MOMENTS = 2


@dataclass(frozen=True, eq=False)
class Subject:
    """A network with what trains it.

    Attributes:
        name: of the form: the package's, in another memory format, or the published code.
        module: whose parameters are trained.
        forward: normalised images -> prediction.
        loss: of its default group.
        optimizer: AdamW.
    """

    name: str
    module: nn.Module
    forward: Callable[[Tensor], Prediction]
    loss: WeightedLoss
    optimizer: Optimizer

    def predict(self, setting: Setting, mode: Mode, image: Tensor, times: int) -> None:
        """Forward passes in a row without gradients."""
        with torch.no_grad(), precision(mode, setting.device):
            for _ in range(times):
                self.forward(image)

    def step(self, setting: Setting, mode: Mode, batch: Batch, times: int = 1) -> None:
        """Training steps in a row: forward, loss, backward, optimiser."""
        for _ in range(times):
            self.optimizer.zero_grad()
            with precision(mode, setting.device):
                prediction = self.forward(batch["image"])
                loss = self.loss(prediction, batch, 0)["total"]
            loss.backward()
            self.optimizer.step()

    def peak_bytes(self, setting: Setting, mode: Mode, batch: Batch) -> int:
        """Bytes that tensors take at the most in a step: weights, moments, gradients and activations."""
        self.optimizer.zero_grad()
        weights = sum(p.numel() * p.element_size() for p in self.module.parameters() if p.requires_grad)
        held = peak_bytes(lambda: self.step(setting, mode, batch), setting.device)
        return held + (1 + ADAMW_MOMENTS) * weights


def subjects(setting: Setting, name: str) -> list[Subject]:
    """The network in its own memory format and in the other, and its twin where there is one."""
    options = options_of(setting, name)
    torch.manual_seed(0)
    network = build_network(options.model, (setting.side, setting.side)).to(setting.device)
    assert isinstance(network, DepthNetwork)
    other = copy.deepcopy(network)
    last = network.memory_format == torch.channels_last
    other.memory_format = torch.contiguous_format if last else torch.channels_last
    other.to(memory_format=other.memory_format)
    found = [
        subject(OWN_FORMAT, network, network.forward_normalised, options),
        subject(f"col3d, channels {'first' if last else 'last'}", other, other.forward_normalised, options),
    ]
    if name in TWINS:
        module = twin(options, network).to(setting.device)
        found.append(subject(TWIN, module, module, options))
    return found


@cache
def options_of(setting: Setting, name: str) -> TrainOptions:
    """Those of `preset=paper` with AdamW for every network."""
    small = {"newcrfs": "swin_tiny_patch4_window7_224", "pix2pix": "none"}
    encoder = [f"model.encoder={small.get(name, 'lcnet_035')}"] if setting.quick else []
    paper = [f"model={name}", "preset=paper", "optimizer=adamw", "model.pretrained=none"]
    return train_options(*paper, *setting.overrides, *encoder)


def twin(options: TrainOptions, network: DepthNetwork) -> nn.Module:
    """The published program for the same encoder and width, with its own angles and activations."""
    if options.model.name == "newcrfs":
        plain = copy.deepcopy(network).to(memory_format=torch.contiguous_format)
        return PublishedNeWCRFs(plain)  # type: ignore[arg-type]
    model = options.model.model_dump(include={"encoder", "width"})
    made = create("col3d_mtl", **model, heads="published")
    return PublishedCol3D(made.to(memory_format=torch.contiguous_format))  # type: ignore[arg-type]


def subject(
    name: str, module: nn.Module, forward: Callable[[Tensor], Prediction], options: TrainOptions
) -> Subject:
    """A module with loss and optimiser of its options."""
    loss = WeightedLoss(options.loss.lambdas, options.loss.terms, options.model.max_depth)
    return Subject(name, module, forward, loss, optimizer_of(options.optimizer)(module))

"""Networks beside their encoder and beside literal twins of the published ones."""

import copy
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import nn

from benchmarks.memory import peak_bytes
from benchmarks.report import Row, row, times
from benchmarks.timing import Work, interleaved, ratios
from benchmarks.twins.col3d import PublishedCol3D
from benchmarks.twins.newcrfs import PublishedNeWCRFs
from col3d.batch import Batch, Prediction
from col3d.geometry import OmnidirectionalCamera, normals_from_depth
from col3d.inference.compiled import compile_network
from col3d.layers.network import DepthNetwork
from col3d.losses import WeightedLoss
from col3d.models import create

FORWARD = "Forward pass, batch of one"
COMPILED = "Forward pass by generated code, batch of one"
TRAINING = "Training step: forward, losses, backward"
MEMORY = "Memory of a training step"
MB = 2**20


@dataclass(frozen=True)
class Case:
    """What is measured on; the defaults are the paper's set-up.

    Attributes:
        side: height and width of images.
        encoder: of Col3D-MTL.
        swin: encoder of NeWCRFs.
        width: F of both.
        batch: of training steps.
        memory_batch: of the step whose memory is told.
    """

    side: int = 320
    encoder: str = "resnet50"
    swin: str = "swin_tiny_patch4_window7_224"
    width: int = 512
    batch: int = 2
    memory_batch: int = 4


def network_rows(case: Case, device: torch.device, repeats: int, compiled: bool = True) -> list[Row]:
    """Times and memory of Col3D-MTL and NeWCRFs."""
    torch.manual_seed(0)
    network = create("col3d_mtl", encoder=case.encoder, width=case.width, heads="published").to(device)
    assert isinstance(network, DepthNetwork)
    twin = PublishedCol3D(copy.deepcopy(network).to(memory_format=torch.contiguous_format))  # type: ignore[arg-type]
    return [
        *_forward_rows(case, network, twin, device, repeats),
        *(_compiled_rows(case, network, device, repeats) if compiled and shutil.which("c++") else []),
        *_training_rows(case, network, twin, device, repeats),
        *_newcrfs_rows(case, device, repeats),
    ]


def encoder_alone(case: Case, device: torch.device) -> nn.Module:
    """Timm's features, as everyone calls them: the measure of all times of forward passes."""
    import timm

    built: nn.Module = timm.create_model(case.encoder, features_only=True, pretrained=False)
    return built.eval().to(device)


def _forward_rows(
    case: Case, network: DepthNetwork, twin: nn.Module, device: torch.device, repeats: int
) -> list[Row]:
    image = torch.randn(1, 3, case.side, case.side, device=device)
    works = {
        "encoder": partial(encoder_alone(case, device), image),
        "twin": partial(twin.eval(), image),
        "col3d_mtl": partial(network.eval().forward_normalised, image),
    }
    seconds = interleaved({name: _plain(work) for name, work in works.items()}, repeats, device)
    return [
        *times(FORWARD, seconds),
        row(FORWARD, "twin / encoder", "x", ratios(seconds["twin"], seconds["encoder"])),
        row(
            FORWARD,
            "col3d_mtl / encoder",
            "x",
            ratios(seconds["col3d_mtl"], seconds["encoder"]),
            at_most=6.5,
        ),
    ]


def _compiled_rows(case: Case, network: DepthNetwork, device: torch.device, repeats: int) -> list[Row]:
    image = torch.randn(1, 3, case.side, case.side, device=device)
    generated = copy.deepcopy(network).eval()
    compile_network(generated, trained=True)
    works = {
        "encoder": _plain(partial(encoder_alone(case, device), image)),
        "col3d_mtl, compiled": _plain(partial(generated, image)),
    }
    seconds = interleaved(works, repeats, device)
    found = ratios(seconds["col3d_mtl, compiled"], seconds["encoder"])
    return [
        *times(COMPILED, seconds),
        row(COMPILED, "col3d_mtl, compiled / encoder", "x", found, at_most=4.5),
    ]


def _training_rows(
    case: Case, network: DepthNetwork, twin: nn.Module, device: torch.device, repeats: int
) -> list[Row]:
    forwards: dict[str, tuple[nn.Module, Callable[..., Prediction]]] = {
        "twin": (twin.train(), twin),
        "col3d_mtl": (network.train(), network.forward_normalised),
    }
    batch, larger = (batch_of(n, case.side, device) for n in (case.batch, case.memory_batch))
    works = {name: partial(step, *pair, batch) for name, pair in forwards.items()}
    works["col3d_mtl, bf16"] = partial(step, *forwards["col3d_mtl"], batch, bf16=True)
    seconds = interleaved(works, repeats, device)
    held = {name: peak_bytes(partial(step, *pair, larger), device) for name, pair in forwards.items()}
    table = f"{TRAINING}, batch of {case.batch}"
    return [
        *times(table, seconds),
        row(table, "col3d_mtl / twin", "x", ratios(seconds["col3d_mtl"], seconds["twin"]), at_most=0.6),
        row(table, "col3d_mtl, bf16 / twin", "x", ratios(seconds["col3d_mtl, bf16"], seconds["twin"])),
        *[row(f"{MEMORY}, batch of {case.memory_batch}", name, "MB", [b / MB]) for name, b in held.items()],
        row(
            f"{MEMORY}, batch of {case.memory_batch}",
            "memory of col3d_mtl / of the twin",
            "x",
            [held["col3d_mtl"] / held["twin"]],
            at_most=0.7,
        ),
    ]


def _newcrfs_rows(case: Case, device: torch.device, repeats: int) -> list[Row]:
    network = create("newcrfs", encoder=case.swin, width=case.width).eval().to(device)
    assert isinstance(network, DepthNetwork)
    image = torch.randn(1, 3, case.side, case.side, device=device)
    works = {
        "newcrfs' twin": _plain(partial(PublishedNeWCRFs(network).eval(), image)),  # type: ignore[arg-type]
        "newcrfs": _plain(partial(network.forward_normalised, image)),
    }
    seconds = interleaved(works, repeats, device)
    found = ratios(seconds["newcrfs"], seconds["newcrfs' twin"])
    return [
        *times(FORWARD, seconds),
        row(FORWARD, "newcrfs / its twin", "x", found, at_most=1.0),
    ]


def batch_of(size: int, side: int, device: torch.device) -> Batch:
    """Frames of noise with the geometry of C3VD's lens."""
    generator = torch.Generator().manual_seed(0)
    rays = OmnidirectionalCamera.c3vd().resized((side, side)).rays().expand(size, -1, -1, -1)
    depth = 40 + 20 * torch.rand(size, 1, side, side, generator=generator)
    mask = torch.ones_like(depth, dtype=torch.bool)
    return {
        "image": torch.rand(size, 3, side, side, generator=generator).to(device),
        "depth": depth.to(device),
        "mask": mask.to(device),
        "normals": normals_from_depth(depth, rays, mask).to(device),
        "rays": rays.contiguous().to(device),
        "video": ["noise"] * size,
        "frame": torch.arange(size),
    }


def step(module: nn.Module, forward: Callable[..., Prediction], batch: Batch, bf16: bool = False) -> None:
    """Forward, the losses of Col3D-MTL, backward."""
    for parameter in module.parameters():
        parameter.grad = None
    with torch.autocast(batch["image"].device.type, torch.bfloat16, enabled=bf16):
        prediction = forward(batch["image"])
    terms = {"depth": "silog", "normals": "normal_l1", "consistency": "cross_task_rmse"}
    loss = WeightedLoss([0.5, 0.3, 0.2], terms)
    loss(prediction, batch, 0)["total"].backward()


def _plain(work: Work) -> Work:
    def run() -> None:
        with torch.no_grad():
            work()

    return run


def smallest(case: Case) -> Case:
    """A case that only shows that all of it runs."""
    return replace(case, side=64, encoder="lcnet_035", width=64, batch=1, memory_batch=1)

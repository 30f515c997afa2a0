"""What is timed against computes the same."""

import pytest
import torch
from torch import Tensor

from benchmarks.memory import peak_bytes
from benchmarks.twins.col3d import PublishedCol3D
from benchmarks.twins.metrics import published_metrics
from benchmarks.twins.newcrfs import PublishedNeWCRFs
from col3d.geometry import unit
from col3d.metrics import Protocol
from col3d.metrics.functional import DEPTH_METRICS, NORMAL_METRICS
from col3d.models import create
from col3d.models.col3d_mtl import published_normals


@pytest.mark.parametrize("training", [False, True])
def test_the_twin_of_col3d_mtl(training: bool) -> None:
    torch.manual_seed(0)
    network = create("col3d_mtl", encoder="resnet18", width=64, heads="published").train(training)
    heads: dict[str, Tensor] = {}
    for axis, head in network.normal_decoder.head.items():
        head.register_forward_hook(lambda _, __, out, axis=axis: heads.update({axis: out}))
    x = torch.randn(2, 3, 64, 96)
    with torch.no_grad():
        depth = network.forward_normalised(x)["depth"]
        normals = published_normals(torch.cat([heads[axis] for axis in "xyz"], dim=1))
        twin = PublishedCol3D(network)(x)
    torch.testing.assert_close(twin["depth"], depth, atol=1e-3, rtol=0)
    torch.testing.assert_close(twin["normals"], normals, atol=1e-4, rtol=0)


def test_the_twin_of_newcrfs() -> None:
    """Also where windows have to be filled up: 96 / 4 is no multiple of 7."""
    torch.manual_seed(0)
    network = create("newcrfs", encoder="swin_tiny_patch4_window7_224", width=64).eval()
    x = torch.randn(1, 3, 96, 64)
    with torch.no_grad():
        torch.testing.assert_close(
            PublishedNeWCRFs(network)(x)["depth"], network.forward_normalised(x)["depth"], atol=1e-3, rtol=0
        )


def test_the_twin_of_the_evaluation() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = 5 + 100 * torch.rand(1, 1, 40, 50, generator=generator)
    guess = depth * (1 + 0.3 * torch.rand(depth.shape, generator=generator))
    normals = unit(torch.randn(1, 3, 40, 50, generator=generator))
    turned = unit(normals + 0.3 * torch.randn(normals.shape, generator=generator))
    protocol = Protocol(truth_range=(1e-3, 100.0), cosine_epsilon=1e-3)
    batch = {"depth": depth, "normals": normals, "mask": torch.ones_like(depth, dtype=torch.bool)}
    ours = protocol.score({"depth": guess, "normals": turned}, batch)  # type: ignore[typeddict-item]
    names = (*DEPTH_METRICS, *NORMAL_METRICS)
    twin = published_metrics(*(values.squeeze().numpy() for values in (guess, depth, turned, normals)))
    assert twin == pytest.approx([ours[name].item() for name in names], rel=2e-4)


def test_peak_of_memory() -> None:
    """Two maps at once at the most, though three are made."""

    def work() -> Tensor:
        total = torch.ones(1 << 20)
        for _ in range(2):
            total = total + 1
        return total

    found = peak_bytes(work, torch.device("cpu"))
    assert 2 * (4 << 20) <= found < 2.1 * (4 << 20)

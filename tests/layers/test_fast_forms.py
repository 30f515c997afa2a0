"""Faster forms of layers give what the plain ones give, and their gradients."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, elu, interpolate

from col3d.layers.conv import FuseELU
from col3d.layers.elu import BLOCK, elu_
from col3d.layers.up_conv import LEAST_PIXELS, up_conv2d
from col3d.models import create

Function = Callable[..., Tensor]


def assert_the_same(fast: Function, plain: Function, *inputs: Tensor, atol: float = 1e-12) -> None:
    """The values and the gradients of every input."""
    inputs = tuple(x.requires_grad_() for x in inputs)
    expected, found = plain(*inputs), fast(*inputs)
    torch.testing.assert_close(found, expected, atol=atol, rtol=1e-5)
    upstream = torch.randn_like(expected)
    for mine, theirs in zip(
        torch.autograd.grad(found, inputs, upstream),
        torch.autograd.grad(expected, inputs, upstream),
        strict=True,
    ):
        torch.testing.assert_close(mine, theirs, atol=atol, rtol=1e-5)


def plain_up_conv(x: Tensor, weight: Tensor) -> Tensor:
    return conv2d(interpolate(x, scale_factor=2, mode="nearest"), weight, padding=1)


@pytest.mark.parametrize("size", [(2, 3, 16, 20), (1, 3, 2, 3), (1, 3, 1, LEAST_PIXELS)])
def test_up_convolution_in_phases(size: tuple[int, ...]) -> None:
    x, weight = torch.randn(size, dtype=torch.float64), torch.randn(4, 3, 3, 3, dtype=torch.float64)
    assert_the_same(up_conv2d, plain_up_conv, x, weight)


def test_elu_by_the_fast_exponential() -> None:
    """Of a map of several blocks, of one with gaps in memory, and with gradients in another order."""
    whole = 3 * torch.randn(2, BLOCK + 7)
    for x in (whole, whole[:, ::3], whole.view(2, 1, -1).transpose(1, 2)):
        # x * 1: what is overwritten must not be a leaf
        assert_the_same(lambda x: elu_(x * 1), elu, x.detach().clone(), atol=2e-7)
        overwritten = x.clone()
        assert elu_(overwritten) is overwritten
        torch.testing.assert_close(overwritten, elu(x), atol=6e-8, rtol=0)
    maps = torch.randn(2, 3, 5, 4).to(memory_format=torch.channels_last)
    assert_the_same(lambda x: elu_(x * 1).flatten(), lambda x: elu(x).flatten(), maps, atol=2e-7)


def test_elu_as_generated_code_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: True)
    for scale in (3.0, 1e-3, 1e-6):  # beside 0, where exp(x) - 1 is rounded to steps of 6e-8
        assert_the_same(lambda x: elu_(x * 1), elu, scale * torch.randn(1000), atol=2e-7)


def test_elu_at_its_ends() -> None:
    ends = torch.tensor([-torch.inf, -100.0, -1e-8, 0.0, 1e-8, 100.0, torch.inf])
    torch.testing.assert_close(elu_(ends.clone()), elu(ends), atol=6e-8, rtol=0)
    assert elu_(torch.tensor([torch.nan])).isnan()


def test_elu_keeps_its_result_alone_for_the_gradient() -> None:
    kept: list[Tensor] = []

    def keep(saved: Tensor) -> Tensor:
        kept.append(saved)
        return saved

    x = torch.randn(5, requires_grad=True) + 1
    with torch.autograd.graph.saved_tensors_hooks(keep, lambda saved: saved):
        out = elu_(x)
    assert [saved.data_ptr() for saved in kept] == [out.data_ptr()]


def test_maps_are_fused_without_being_put_together() -> None:
    torch.manual_seed(0)
    fuse = FuseELU(7, 5).double()
    maps = [torch.randn(2, channels, 6, 8, dtype=torch.float64) for channels in (4, 2, 1)]

    def plain(*maps: Tensor) -> Tensor:
        return elu(conv2d(torch.cat(maps, dim=1), fuse.get_parameter("0.weight"), padding=1))

    assert_the_same(fuse, plain, *maps)
    empty = maps[0].detach()[:, :0]
    torch.testing.assert_close(fuse(*maps, empty), plain(*maps))


@pytest.mark.parametrize("name", ["col3d_mtl", "pix2pix"])
def test_weights_lie_as_the_images_do(name: str) -> None:
    options = {"encoder": "none", "size_hw": (64, 64)} if name == "pix2pix" else {"encoder": "resnet18"}
    network = create(name, width=64, **options)
    convolutions = [m for m in network.modules() if isinstance(m, nn.Conv2d) and m.kernel_size == (3, 3)]
    assert all(m.weight.is_contiguous(memory_format=network.memory_format) for m in convolutions)

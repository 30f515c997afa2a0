"""Each faster form beside the plain one, forward and backward."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.functional import conv2d, elu, interpolate

from benchmarks.report import Row, row, times
from benchmarks.timing import Work, interleaved, ratios
from col3d.layers.conv import FuseELU
from col3d.layers.elu import elu_
from col3d.layers.up_conv import up_conv2d

BATCH = 2
Function = Callable[..., Tensor]


def piece_rows(side: int, device: torch.device, repeats: int) -> list[Row]:
    """Milliseconds of maps as Col3D-MTL has them for images of that side, channels last."""
    torch.manual_seed(0)
    at1, at2 = (_map(channels, side // k, device) for channels, k in ((32, 1), (64, 2)))
    upward = _weight(32, 64, device)
    plane, fuse = _map(4, side, device), FuseELU(36, 32).to(device)
    rows = []
    for name, plain, fast, inputs in (
        ("up-convolution to full size", _enlarged_conv, up_conv2d, (at2, upward)),
        ("ELU at full size", lambda x: elu(x * 1), lambda x: elu_(x * 1), (at1,)),
        ("fusing at full size", lambda *maps: _joined(fuse, *maps), fuse, (at1, plane)),
    ):
        works = {"plain": _both_ways(plain, inputs), "as it is": _both_ways(fast, inputs)}
        seconds = interleaved(works, repeats, device)
        table = f"{name[0].upper()}{name[1:]}, forward and backward, batch of {BATCH}"
        rows += times(table, {f"{name}, {form}": taken for form, taken in seconds.items()})
        rows.append(
            row(table, f"{name}, plain / as it is", "x", ratios(seconds["plain"], seconds["as it is"]))
        )
    return [*rows, *_order_rows(side, device, repeats)]


def _order_rows(side: int, device: torch.device, repeats: int) -> list[Row]:
    last, weight = _map(36, side, device).detach(), _weight(32, 36, device).detach()
    first, plain = last.contiguous(), weight.contiguous()
    works: dict[str, Work] = {
        "channels first": lambda: conv2d(first, plain, padding=1),
        "channels last": lambda: conv2d(last, weight, padding=1),
    }
    seconds = interleaved(works, repeats, device)
    table = f"A 3x3 convolution of 36 channels to 32 at full size, batch of {BATCH}"
    return [
        *times(table, seconds),
        row(table, "channels first / last", "x", ratios(*seconds.values())),
    ]


def _map(channels: int, side: int, device: torch.device) -> Tensor:
    values = torch.randn(BATCH, channels, side, side, device=device)
    return values.to(memory_format=torch.channels_last).requires_grad_()


def _weight(out_channels: int, in_channels: int, device: torch.device) -> Tensor:
    values = torch.randn(out_channels, in_channels, 3, 3, device=device)
    return values.to(memory_format=torch.channels_last).requires_grad_()


def _enlarged_conv(x: Tensor, weight: Tensor) -> Tensor:
    return conv2d(interpolate(x, scale_factor=2, mode="nearest"), weight, padding=1)


def _joined(fuse: FuseELU, *maps: Tensor) -> Tensor:
    return elu(conv2d(torch.cat(maps, dim=1), fuse.get_parameter("0.weight"), padding=1))


def _both_ways(function: Function, inputs: tuple[Tensor, ...]) -> Work:
    with torch.no_grad():
        upstream = torch.randn_like(function(*inputs))
    return lambda: torch.autograd.grad(function(*inputs), inputs, upstream)

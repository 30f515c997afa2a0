"""A twin of the published NeWCRFs: its operations one by one, on a network's own layers.

What it does literally: tokens as a sequence between blocks, windows cut by a six-dimensional permutation, the
table of biases looked up and copied at each call, the mask of shifted windows made from numbered regions.
"""

import torch
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.layers.window_attention import WINDOW, WindowAttention, WindowBlock
from col3d.models.newcrfs import NeuralCRF, NeWCRFs


class PublishedNeWCRFs(nn.Module):
    """The published forward pass of a network.

    Args:
        network: whose layers and weights it uses.
    """

    def __init__(self, network: NeWCRFs) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor) -> Prediction:
        """A normalised image whose sides are multiples of 32 -> depth in mm."""
        net = self.network
        at4, at8, at16, at32 = self._encoded(x)
        stages = zip((net.crf32, net.crf16, net.crf8, net.crf4), (at32, at16, at8, at4), strict=True)
        above = net.pyramid(at32)
        for stage, features in stages:
            above = _crf(stage, features, above)
            if stage is not net.crf4:
                above = nn.functional.pixel_shuffle(above, 2)
        fraction = torch.sigmoid(net.head(above))
        return {"depth": nn.functional.interpolate(fraction, scale_factor=4, mode="bilinear") * net.max_depth}

    def _encoded(self, x: Tensor) -> list[Tensor]:
        encoder, taps = self.network.encoder, []
        x = encoder.patch_embed.proj(x)
        size = (x.shape[2], x.shape[3])
        x = encoder.patch_embed.norm(x.flatten(2).transpose(1, 2))
        for stage, norm in zip(encoder.layers, encoder.norms, strict=True):
            merging = stage.get_submodule("downsample")
            if not isinstance(merging, nn.Identity):
                x, size = _merged(merging, x, size)
            x = _blocks(list(stage.get_submodule("blocks").children()), x, None, size)
            taps.append(norm(x).view(-1, *size, x.shape[-1]).permute(0, 3, 1, 2).contiguous())
        return taps


def _merged(merging: nn.Module, x: Tensor, size: tuple[int, int]) -> tuple[Tensor, tuple[int, int]]:
    x = x.view(-1, *size, x.shape[-1])
    corners = [x[:, down::2, right::2] for right in (0, 1) for down in (0, 1)]
    x = torch.cat(corners, dim=-1)
    half = (x.shape[1], x.shape[2])
    normed = merging.get_submodule("norm")(x.view(len(x), -1, x.shape[-1]))
    return merging.get_submodule("reduction")(normed), half


def _crf(stage: NeuralCRF, features: Tensor, above: Tensor) -> Tensor:
    x, value = stage.to_x(features), stage.to_value(above)
    size = (x.shape[2], x.shape[3])
    x, value = x.flatten(2).transpose(1, 2), value.flatten(2).transpose(1, 2)
    x = stage.norm(_blocks(list(stage.blocks), x, value, size))
    return x.view(-1, *size, x.shape[-1]).permute(0, 3, 1, 2).contiguous()


def _blocks(blocks: list[nn.Module], x: Tensor, value: Tensor | None, size: tuple[int, int]) -> Tensor:
    mask = _mask(size, x)
    for block in blocks:
        assert isinstance(block, WindowBlock)
        attended = _attended(block.attn, block.norm1(x), value, size, mask)
        x = x + block.drop_path(attended)
        x = x + block.drop_path(block.mlp(block.norm2(x)))
    return x


def _mask(size: tuple[int, int], like: Tensor) -> Tensor:
    """0 between pixels that were neighbours before the roll, -100 between others."""
    full = [side + -side % WINDOW for side in size]
    numbers, shift = like.new_zeros(1, *full, 1), WINDOW // 2
    spans = (slice(0, -WINDOW), slice(-WINDOW, -shift), slice(-shift, None))
    for number, (rows, columns) in enumerate((rows, columns) for rows in spans for columns in spans):
        numbers[:, rows, columns] = number
    windows = _cut(numbers).view(-1, WINDOW * WINDOW)
    apart = windows.unsqueeze(1) - windows.unsqueeze(2)
    return apart.masked_fill(apart != 0, -100.0).masked_fill(apart == 0, 0.0)


def _cut(x: Tensor) -> Tensor:
    b, height, width, c = x.shape
    x = x.view(b, height // WINDOW, WINDOW, width // WINDOW, WINDOW, c)
    return x.permute(0, 1, 3, 2, 4, 5).contiguous().view(-1, WINDOW * WINDOW, c)


def _attended(
    layer: WindowAttention, x: Tensor, value: Tensor | None, size: tuple[int, int], mask: Tensor
) -> Tensor:
    b, _, c = x.shape
    height, width = size
    windows = _windows(x, size, layer.shift)
    heads = (len(windows), WINDOW * WINDOW, -1, layer.heads, c // layer.heads)
    q, k, *own = layer.qkv(windows).reshape(heads).permute(2, 0, 3, 1, 4)
    given = windows if value is None else _windows(value, size, layer.shift)
    v = own[0] if own else given.reshape(heads).permute(2, 0, 3, 1, 4)[0]
    scores = (q * (c // layer.heads) ** -0.5) @ k.transpose(-2, -1)
    table = layer.relative_position_bias_table[layer.offsets.view(-1)]
    bias = table.view(WINDOW * WINDOW, WINDOW * WINDOW, -1).permute(2, 0, 1).contiguous()
    scores = scores + bias.unsqueeze(0)
    if layer.shift:
        count = len(mask)
        scores = scores.view(-1, count, layer.heads, *scores.shape[-2:]) + mask.unsqueeze(1).unsqueeze(0)
        scores = scores.view(-1, layer.heads, *scores.shape[-2:])
    attended = layer.proj((scores.softmax(dim=-1) @ v).transpose(1, 2).reshape(len(windows), -1, c))
    full = (height + -height % WINDOW, width + -width % WINDOW)
    grid = attended.view(b, full[0] // WINDOW, full[1] // WINDOW, WINDOW, WINDOW, c)
    whole = grid.permute(0, 1, 3, 2, 4, 5).contiguous().view(b, *full, c)
    if layer.shift:
        whole = torch.roll(whole, shifts=(layer.shift, layer.shift), dims=(1, 2))
    return whole[:, :height, :width].contiguous().view(b, height * width, c)


def _windows(x: Tensor, size: tuple[int, int], shift: int) -> Tensor:
    x = x.reshape(len(x), *size, x.shape[-1])
    x = nn.functional.pad(x, (0, 0, 0, -size[1] % WINDOW, 0, -size[0] % WINDOW))
    return _cut(torch.roll(x, shifts=(-shift, -shift), dims=(1, 2)) if shift else x)

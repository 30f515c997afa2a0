"""Metrics beside the published evaluation, geometry beside a copy of its bytes."""

from functools import partial

import torch

from benchmarks.report import Row, row, times
from benchmarks.timing import Work, interleaved, ratios
from benchmarks.twins.metrics import published_metrics
from col3d.geometry import OmnidirectionalCamera, normals_from_depth, unit
from col3d.metrics.functional import depth_metrics, normal_metrics

BATCH = 8
METRICS = f"All 14 metrics of a batch of {BATCH}"
GEOMETRY = f"normals_from_depth of a batch of {BATCH}, forward and backward"
FLOATS_READ_AND_WRITTEN = 11.25
"""Of a pixel: depth, ray, mask (a byte) and gradient of the normal; normal and gradient of the depth."""


def metric_rows(side: int, device: torch.device, repeats: int) -> list[Row]:
    """Milliseconds a frame."""
    generator = torch.Generator().manual_seed(0)
    depth = 5 + 80 * torch.rand(BATCH, 1, side, side, generator=generator)
    guess = depth * (1 + 0.1 * torch.randn(depth.shape, generator=generator))
    normals = unit(torch.randn(BATCH, 3, side, side, generator=generator))
    turned = unit(normals + 0.2 * torch.randn(normals.shape, generator=generator))
    mask = torch.rand(depth.shape, generator=generator) > 0.05
    ours = [values.to(device) for values in (guess, depth, turned, normals, mask)]

    def measured() -> None:
        depth_metrics(ours[0], ours[1], ours[4])
        normal_metrics(ours[2], ours[3], ours[4])

    def twin() -> None:
        for i in range(BATCH):
            published_metrics(*(values[i].numpy() for values in (guess[:, 0], depth[:, 0], turned, normals)))

    seconds = interleaved({"published, numpy": twin, "col3d": measured}, repeats, device)
    found = ratios(seconds["published, numpy"], seconds["col3d"])
    return [
        *[row(METRICS, name, "ms a frame", [1000 * s / BATCH for s in t]) for name, t in seconds.items()],
        row(METRICS, "published / col3d", "x", found, at_least=2.0),
    ]


def geometry_rows(side: int, device: torch.device, repeats: int) -> list[Row]:
    """Milliseconds a batch, and those of a copy that reads and writes as many bytes."""
    rays = OmnidirectionalCamera.c3vd().resized((side, side)).rays()
    rays = rays.expand(BATCH, -1, -1, -1).contiguous().to(device)
    depth = (50 + 10 * torch.rand(BATCH, 1, side, side, device=device)).requires_grad_()
    mask = torch.rand(BATCH, 1, side, side, device=device) > 0.05
    upstream = torch.randn(BATCH, 3, side, side, device=device)
    floats = torch.randn(int(BATCH * side * side * FLOATS_READ_AND_WRITTEN / 2), device=device)
    copied = torch.empty_like(floats)

    def derive() -> None:
        torch.autograd.grad(normals_from_depth(depth, rays, mask), depth, upstream)

    works: dict[str, Work] = {"copy of as many bytes": partial(copied.copy_, floats)}
    works["normals_from_depth"] = derive
    seconds = interleaved(works, repeats, device)
    found = ratios(seconds["normals_from_depth"], seconds["copy of as many bytes"])
    return [
        *times(GEOMETRY, seconds),
        row(GEOMETRY, "normals_from_depth / copy", "x", found, at_most=3.0),
    ]


def floor_rows(device: torch.device, repeats: int) -> list[Row]:
    """How fast this machine multiplies matrices and copies, at its best."""
    size = 2048
    a, b = (torch.randn(size, size, device=device) for _ in range(2))
    source = torch.randn(2**26, device=device)
    target = torch.empty_like(source)
    works = {"matrices": partial(torch.matmul, a, b), "copy": partial(target.copy_, source)}
    seconds = interleaved(works, repeats, device)
    table = "What the machine does at its best"
    return [
        row(table, "product of matrices", "GFLOP/s", [2e-9 * size**3 / s for s in seconds["matrices"]]),
        row(table, "copy, read and written", "GB/s", [8e-9 * len(source) / s for s in seconds["copy"]]),
    ]

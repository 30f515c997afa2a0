"""Measurement of a network's cost: parameters, operations and time."""

import time
from typing import Any

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from col3d.geometry import OmnidirectionalCamera
from col3d.layers.network import device_of

WARM_UP, TIMED = 2, 5


def measure_cost(network: nn.Module, size_hw: tuple[int, int]) -> dict[str, Any]:
    """Measure the cost of one frame on the network's device; the network is left in evaluation mode.

    Returns:
        `parameters`; `gflop`: 1e9 multiplications and additions of one forward pass, as torch counts them;
        `frames_per_second`: of forward passes of one frame, the median of a few; `size`, `device` and
        `threads`, on which that time depends.
    """
    device = device_of(network)
    image = torch.rand(1, 3, *size_hw, device=device)
    rays = OmnidirectionalCamera.c3vd().resized(size_hw).rays().to(device)
    network.eval()
    with torch.no_grad():
        with FlopCounterMode(display=False) as counter:
            network.forward(image, rays)  # a compiled network's operations cannot be counted
        seconds = sorted(_seconds(network, image, rays) for _ in range(WARM_UP + TIMED))
    return {
        "parameters": sum(p.numel() for p in network.parameters()),
        "gflop": counter.get_total_flops() / 1e9,
        "frames_per_second": 1 / seconds[len(seconds) // 2],
        "size": list(size_hw),
        "device": _device(device),
        "threads": torch.get_num_threads(),
    }


def _seconds(network: nn.Module, image: torch.Tensor, rays: torch.Tensor) -> float:
    start = time.perf_counter()
    network(image, rays)
    if image.is_cuda:
        torch.cuda.synchronize(image.device)
    return time.perf_counter() - start


def _device(device: torch.device) -> str:
    return torch.cuda.get_device_name(device) if device.type == "cuda" else "cpu"

"""The largest batch of Col3D-MTL that a GPU holds, beside what `benchmarks.scaling` computes."""

from collections.abc import Callable, Iterator

import torch

from benchmarks.gpu.networks import OWN_FORMAT, Subject, subjects
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import FLOAT32, Setting
from benchmarks.networks import batch_of
from benchmarks.scaling import GB, KEPT_FREE

NETWORK = "col3d_mtl"
FIXED, EACH = 0.61e9, 5.33e3
"""Bytes without a frame, and bytes of a pixel, that `python -m benchmarks.scaling` measured."""
AIM = 0.9
"""Share of the computed batch that has to fit."""


def largest(setting: Setting, item: str) -> Iterator[Record]:
    """Try training steps of batches between half and twice the computed one."""
    row: Record = {"table": f"The largest batch of Col3D-MTL at {setting.side} x {setting.side} in float32"}
    if setting.device.type != "cuda":
        yield row | {"largest batch": "not measured: needs CUDA"}
        return
    network = next(made for made in subjects(setting, NETWORK) if made.name == OWN_FORMAT)
    network.module.train()
    memory = torch.cuda.get_device_properties(setting.device).total_memory
    computed = int((memory - KEPT_FREE * GB - FIXED) // (EACH * setting.side**2))
    found = most(lambda batch: _fits(setting, network, batch), computed // 2, 2 * computed)
    yield row | {"GB of the card": memory / GB, "computed": computed, "largest batch": found}
    ratio = found / computed
    aims: Record = {"table": "Aims", "network": NETWORK, "what": "largest batch / the computed one"}
    yield {**aims, "ratio": ratio, "aim": f"at least {AIM:g}", "": ratio >= AIM}


def most(fits: Callable[[int], bool], low: int, high: int) -> int:
    """The largest number from `low` to `high` that fits, if all below one that fits do; 0 if none does.

    >>> most(lambda number: number <= 13, 4, 40)
    13
    """
    if low < 1 or not fits(low):
        return 0
    while high > low:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(middle) else (low, middle - 1)
    return low


def _fits(setting: Setting, network: Subject, batch: int) -> bool:
    try:
        network.step(setting, FLOAT32, batch_of(batch, setting.side, setting.device))
        torch.cuda.synchronize(setting.device)
    except torch.cuda.OutOfMemoryError:
        return False
    finally:
        network.optimizer.zero_grad()
        torch.cuda.empty_cache()
    return True

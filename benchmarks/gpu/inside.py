"""Where the time of a training step of Col3D-MTL goes, and whether the host waits for the device in it."""

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import torch
from torch.autograd import DeviceType
from torch.profiler import ProfilerActivity, profile

from benchmarks.gpu.networks import OWN_FORMAT, TWIN, Subject, subjects
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import MS, Mode, Setting
from benchmarks.networks import batch_of
from benchmarks.timing import Work, seconds_of
from col3d.batch import Batch

NETWORK = "col3d_mtl"
KINDS = {
    "copies": r"copy|memcpy|memset|fill|zero_|catarray|aten::cat|nchwtonhwc|nhwctonchw|transpose",
    "convolutions": r"conv(?!ert)|gem[mv]|xmma|wgrad|dgrad|fprop|cutlass|winograd|scudnn|nvjet|::(add|b)?mm$",
}
"""Names of kernels of a GPU and of operations of a CPU; the first that matches counts."""
REST = "everything else"
ROUNDS = 3
LISTED = 15
WALL_US = 1e6


def inside(setting: Setting, item: str) -> Iterator[Record]:
    """Shares of the device's time, and synchronisations of a step, in each precision."""
    batch = batch_of(setting.batch, setting.side, setting.device)
    for subject in [made for made in subjects(setting, NETWORK) if made.name in (OWN_FORMAT, TWIN)]:
        subject.module.train()
        for mode in setting.modes[-1:] if setting.quick else setting.modes:
            for _ in range(2):  # moments are made at the first
                subject.step(setting, mode, batch)
            if subject.name != TWIN:
                yield waits_of(setting, "training step", mode, partial(subject.step, setting, mode, batch))
            yield _shares(setting, subject, mode, batch)


def _shares(setting: Setting, subject: Subject, mode: Mode, batch: Batch) -> Record:
    cuda = setting.device.type == "cuda"
    seconds = [seconds_of(lambda: subject.step(setting, mode, batch), setting.device) for _ in range(ROUNDS)]
    activities = [ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if cuda else [])]
    with profile(activities=activities) as found:
        subject.step(setting, mode, batch)
        if cuda:
            torch.cuda.synchronize(setting.device)
    kernels: Counter[str] = Counter()
    calls = 0
    for event in found.key_averages():
        if taken := _microseconds(event, cuda):
            kernels[event.key] += taken  # type: ignore[assignment]
            calls += event.count
    total = sum(kernels.values())
    if not total:
        raise ValueError("the profiler recorded no kernel of a training step")
    shares = dict.fromkeys((*KINDS, REST), 0.0)
    for name, taken in kernels.items():
        shares[kind_of(name)] += taken / total
    return {
        "table": f"Col3D-MTL's training step by what it computes, {setting.size}",
        "form": subject.name,
        "precision": mode.name,
        **{f"{kind}, %": 100 * share for kind, share in shares.items()},
        "ms of a step": MS * median(seconds),
        "device busy, %": 100 * total / WALL_US / median(seconds),
        "kernels a step": calls,
        "longest, us a step": [[name, taken] for name, taken in kernels.most_common(LISTED)],
    }


def kind_of(name: str) -> str:
    """What a kernel does, by its name."""
    lowered = name.lower()
    return next((kind for kind, pattern in KINDS.items() if re.search(pattern, lowered)), REST)


def _microseconds(event: Any, cuda: bool) -> float:
    """Of a kernel; 0 of what the profiler only marks, as `Optimizer.step`."""
    if not cuda:
        return float(event.self_cpu_time_total)
    marked = event.is_user_annotation or event.key.startswith(("Optimizer.", "ProfilerStep"))
    return 0.0 if marked or event.device_type != DeviceType.CUDA else float(event.self_device_time_total)


def waits_of(setting: Setting, name: str, mode: Mode, work: Work) -> Record:
    """How often the host waits for the device in a work, and where."""
    row: Record = {"table": "Waits of the host for the device", "in": name, "precision": mode.name}
    if setting.device.type != "cuda":
        work()
        return row | {"synchronisations": "not measured: needs CUDA"}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            work()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    waits = [warning for warning in caught if "synchroniz" in str(warning.message)]
    places = Counter(f"{Path(warning.filename).name}:{warning.lineno}" for warning in waits)
    return row | {
        "synchronisations": len(waits),
        "at": ", ".join(f"{place} ({count})" for place, count in places.most_common()) or "-",
    }

"""Training steps and forward passes of Col3D-MTL in generated code, beside plain and published code."""

import copy
import time
from collections.abc import Iterator
from statistics import median

import torch

from benchmarks.gpu.networks import OWN_FORMAT, TWIN, Subject, options_of, subject, subjects
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import BFLOAT16, FLOAT32, MS, TF32, Mode, Setting
from benchmarks.gpu.speed import Key, forward_seconds, step_seconds
from benchmarks.networks import batch_of
from benchmarks.timing import ratios
from col3d.inference.compiled import compile_network
from col3d.layers.network import DepthNetwork

NETWORK = "col3d_mtl"
KINDS = (("step", step_seconds), ("forward", forward_seconds))


def compiled(setting: Setting, item: str) -> Iterator[Record]:
    """In the fastest precision first, for each takes the compiler long."""
    plain, published = _pair(setting)
    for cudagraphs in (False, True):
        generated = _generated(setting, plain, cudagraphs)
        for mode in (BFLOAT16,) if setting.quick else (BFLOAT16, TF32):
            keys: list[Key] = [(generated, mode), (plain, mode), (published, FLOAT32)]
            for kind, measure in KINDS[: 1 if setting.quick else None]:
                until = _first(setting, generated, mode, kind == "step")
                seconds = measure(setting, keys)
                taken = {key[0].name: seconds[key] for key in keys}
                ours = taken[generated.name]
                yield {
                    "table": f"Col3D-MTL in generated code (torch.compile), {setting.size}",
                    "what": f"{kind}, CUDA graphs" if cudagraphs else kind,
                    "precision": mode.name,
                    "first, s": until,
                    **{f"{name}, ms": MS * median(values) for name, values in taken.items()},
                    "col3d / compiled": median(ratios(taken[OWN_FORMAT], ours)),
                    "published code in float32 / compiled": median(
                        ratios(taken[TWIN], taken[generated.name])
                    ),
                }


def _pair(setting: Setting) -> tuple[Subject, Subject]:
    found = {made.name: made for made in subjects(setting, NETWORK)}
    return found[OWN_FORMAT], found[TWIN]


def _generated(setting: Setting, plain: Subject, cudagraphs: bool) -> Subject:
    network = copy.deepcopy(plain.module)
    assert isinstance(network, DepthNetwork)
    if setting.quick:
        network.compile(backend="eager", dynamic=False)  # traces as the compiler does, and generates nothing
    else:
        compile_network(network, cudagraphs=cudagraphs)
    # images are those of a batch: normalising them is in the generated code, and too little to matter
    return subject("compiled", network, network.__call__, options_of(setting, NETWORK))


def _first(setting: Setting, generated: Subject, mode: Mode, training: bool) -> float:
    """Seconds of the first call, in which code is generated."""
    batch = batch_of(setting.batch, setting.side, setting.device)
    generated.module.train(training)
    start = time.perf_counter()
    if training:
        generated.step(setting, mode, batch)
    else:
        generated.predict(setting, mode, batch["image"], 1)
    if setting.device.type == "cuda":
        torch.cuda.synchronize(setting.device)
    return time.perf_counter() - start

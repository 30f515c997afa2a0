"""From a prepared store to the training step of Col3D-MTL: is the device ever waiting for frames?"""

import os
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks.frames import frames_of, prepared
from benchmarks.gpu.inside import waits_of
from benchmarks.gpu.networks import OWN_FORMAT, Subject, subjects
from benchmarks.gpu.results import Record
from benchmarks.gpu.setting import BFLOAT16, Setting
from benchmarks.loading import Loading, on_device, our_loader, wait_for
from benchmarks.networks import batch_of
from benchmarks.timing import Work, interleaved, ratios
from col3d.data.cache import Stored
from col3d.data.cache.codes import QuantizedBatch, decode
from col3d.data.transforms import Augment, draws_of

NETWORK = "col3d_mtl"
RENDERED_HW, RENDERED = (324, 405), 16
"""Size and number of the phantom's frames, of which the store holds copies."""
EPOCH = 400
WORKERS = 8
ROUNDS = 2
LOADER_AIM, BUSY_AIM = 3.0, 0.95


class Epoch:
    """Passes over a store: loading alone, with decoding and augmentation on the device, with the step too."""

    def __init__(self, setting: Setting, stored: Stored, loading: Loading, network: Subject) -> None:
        self.setting, self.stored, self.network = setting, stored, network
        self.loader = our_loader(stored, loading)
        self.batch = batch_of(setting.batch, setting.side, setting.device)
        self.waits: list[float] = []

    def load(self) -> None:
        """Batches of codes, as workers hand them over."""
        for _ in self.loader:
            pass

    def run(self, step: bool) -> None:
        """Batches that are decoded and augmented on the device, and trained on."""
        waited = 0.0
        batches = iter(self.loader)
        while True:
            start = time.perf_counter()
            codes = next(batches, None)
            waited += time.perf_counter() - start
            if codes is None:
                break
            self.take(codes, step)
        wait_for(self.setting.device)
        if step:
            self.waits.append(waited)

    def take(self, codes: QuantizedBatch, step: bool) -> None:
        """One batch as it comes from the loader."""
        draws = draws_of(codes, seed=0, epoch=0).to(self.setting.device, non_blocking=True)
        decoded = decode(on_device(codes, self.setting.device), self.stored.cameras)
        batch = Augment()(decoded, draws)
        if step:
            self.network.step(self.setting, BFLOAT16, batch)

    def steps(self) -> None:
        """As many steps on a batch that is on the device already."""
        self.network.step(self.setting, BFLOAT16, self.batch, len(self.loader))
        wait_for(self.setting.device)


def loader(setting: Setting, item: str) -> Iterator[Record]:
    """Rates of each part and of all together, in bfloat16, which keeps the device busy for the least time."""
    network = next(made for made in subjects(setting, NETWORK) if made.name == OWN_FORMAT)
    network.module.train()
    workers = 1 if setting.quick else min(WORKERS, os.cpu_count() or 1)
    size_hw, rendered = (setting.side, setting.side), 2 if setting.quick else RENDERED
    with tempfile.TemporaryDirectory(prefix="store-") as folder:
        parts = frames_of("phantom", None, Path(folder), _rendered_hw(setting), rendered)
        count = 4 * setting.batch if setting.quick else EPOCH
        videos = prepared(parts, Path(folder, "store"), size_hw, count)
        stored = Stored([(video, video.frames) for video in videos])
        loading = Loading(size_hw, workers, setting.batch, setting.device)
        yield from _records(setting, Epoch(setting, stored, loading, network), workers)


def _records(setting: Setting, epoch: Epoch, workers: int) -> Iterator[Record]:
    works: dict[str, Work] = {
        "loader": epoch.load,
        "loader, decoding and augmentation on the device": partial(epoch.run, False),
        "step on a batch that is there": epoch.steps,
        "all together": partial(epoch.run, True),
    }
    seconds = interleaved(works, 1 if setting.quick else ROUNDS)
    table = {"table": f"From a prepared store to the step in bfloat16, {setting.size}, {workers} workers"}
    frames = len(epoch.stored)
    for name, taken in seconds.items():
        waited = 100 * median(epoch.waits[1:]) / median(taken) if name == "all together" else None
        yield {**table, "what": name, "frames/s": frames / median(taken), "host waits for batches, %": waited}
    one = partial(epoch.take, next(iter(epoch.loader)), True)
    yield waits_of(setting, "transfer, decoding, augmentation and step", BFLOAT16, one)
    loading, _, step, together = seconds.values()
    for what, ratio, aim in (
        ("loader's frames/s / the step's", median(ratios(step, loading)), LOADER_AIM),
        ("time of the steps alone / of all together", median(ratios(step, together)), BUSY_AIM),
    ):
        row = {"table": "Aims", "network": NETWORK, "what": what, "ratio": ratio}
        yield {**row, "aim": f"at least {aim:g}", "": ratio >= aim}


def _rendered_hw(setting: Setting) -> tuple[int, int]:
    return (64, 80) if setting.quick else RENDERED_HW

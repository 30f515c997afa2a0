"""Loaders: each frame once where it is counted, and orders that differ by epoch and come back."""

import multiprocessing
import multiprocessing.util
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch.utils.data import Dataset

from col3d.data.datamodule import FrameDataModule
from col3d.data.resize import Resize
from col3d.data.samplers import ShardedSampler, WeightedOrder
from col3d.data.transforms import Augment, draws_of
from col3d.data.workers import SteadyLoader


class Numbered(Dataset[dict[str, Any]]):
    def __init__(self, item: dict[str, Any], count: int) -> None:
        self.item, self.count = item, count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> dict[str, Any]:
        return {**self.item, "frame": index}


def module_of(item: dict[str, Any], seed: int = 0, augment: Augment | None = None) -> FrameDataModule:
    small = Resize((20, 25), item["camera"])(item)
    del small["camera"]
    frames = {name: Numbered(small, n) for name, n in {"train": 11, "val": 7, "test": 5}.items()}
    return FrameDataModule(frames, batch_size=3, augment=augment, seed=seed)


def order(loader: Any, epoch: int = 0) -> list[int]:
    if hasattr(loader.batch_sampler.sampler, "set_epoch"):
        loader.batch_sampler.sampler.set_epoch(epoch)
    return [number for batch in loader for number in batch["frame"].tolist()]


@pytest.mark.parametrize("length", [0, 1, 5, 12])
@pytest.mark.parametrize("world_size", [1, 2, 3, 7])
def test_each_frame_once_over_all_processes(length: int, world_size: int) -> None:
    samplers = [ShardedSampler(length, rank, world_size) for rank in range(world_size)]
    assert sorted(index for sampler in samplers for index in sampler) == list(range(length))
    for sampler in samplers:
        assert len(list(sampler)) == len(sampler) <= -(-length // world_size)


def test_evaluation_is_in_order(item: dict[str, Any]) -> None:
    module = module_of(item)
    assert order(module.val_dataloader()) == list(range(7))
    assert order(module.test_dataloader()) == list(range(5))


def test_training_is_shuffled_anew_each_epoch_and_reproducibly(item: dict[str, Any]) -> None:
    loader = module_of(item).train_dataloader()
    first, second = order(loader, 0), order(loader, 1)
    assert sorted(first) == sorted(second) == list(range(11))
    assert first != list(range(11))
    assert first != second
    torch.manual_seed(123)
    assert order(module_of(item).train_dataloader(), 0) == first
    assert order(module_of(item, seed=1).train_dataloader(), 0) != first


def test_processes_share_the_frames(item: dict[str, Any]) -> None:
    found: dict[str, list[int]] = {"train": [], "val": []}
    for rank in range(3):
        module = module_of(item)
        module.trainer = SimpleNamespace(global_rank=rank, world_size=3)  # type: ignore[assignment]
        found["train"] += order(module.train_dataloader())
        found["val"] += order(module.val_dataloader())
    assert sorted(found["val"]) == list(range(7))
    assert set(found["train"]) == set(range(11))


def test_batches_are_batches(item: dict[str, Any]) -> None:
    batch = next(iter(module_of(item).val_dataloader()))
    assert batch["depth"].shape == (3, 1, 20, 25)
    assert batch["mask"].dtype == torch.bool
    assert batch["video"] == ["cecum_t1_a"] * 3
    assert batch["frame"].tolist() == [0, 1, 2]
    sizes = [len(batch["frame"]) for batch in module_of(item).train_dataloader()]
    assert sizes == [3, 3, 3, 2]


def test_only_training_batches_are_augmented(item: dict[str, Any]) -> None:
    augment = Augment(rotation=20.0)
    module = module_of(item, seed=5, augment=augment)
    batch = next(iter(module.val_dataloader()))

    def transferred() -> Any:
        return module.on_after_batch_transfer(module.on_before_batch_transfer(batch, 0), 0)

    assert transferred() is batch
    trainer = SimpleNamespace(training=False, current_epoch=3, global_rank=0, world_size=1)
    module.trainer = trainer  # type: ignore[assignment]
    assert transferred() is batch
    trainer.training = True
    found = transferred()
    assert torch.equal(found["depth"], augment(batch, draws_of(batch, seed=5, epoch=3))["depth"])
    assert not torch.equal(found["depth"], batch["depth"])
    trainer.current_epoch = 4
    assert not torch.equal(transferred()["depth"], found["depth"])


# several data sets


def shown(parts: list[tuple[int, float]], epoch: int, rank: int = 0, world_size: int = 1) -> list[int]:
    sampler = WeightedOrder(parts, seed=3, rank=rank, world_size=world_size)
    sampler.set_epoch(epoch)
    chosen = list(sampler)
    assert len(chosen) == len(sampler)
    return chosen


def test_weights_say_how_often_an_epoch_shows_a_frame() -> None:
    parts = [(10, 1.0), (8, 2.5), (20, 0.25)]
    for epoch in range(3):
        counts = Counter(shown(parts, epoch))
        assert [counts[index] for index in range(10)] == [1] * 10
        assert {counts[index] for index in range(10, 18)} == {2, 3}
        assert sum(counts[index] for index in range(10, 18)) == 20
        assert sorted(counts[index] for index in range(18, 38)) == [0] * 15 + [1] * 5
    assert shown(parts, 0) != shown(parts, 1)
    assert shown(parts, 1) == shown(parts, 1)
    assert set().union(*(shown(parts, epoch) for epoch in range(40))) == set(range(38))


def test_data_sets_are_mixed_within_an_epoch() -> None:
    first_half = shown([(50, 1.0), (50, 1.0)], 0)[:50]
    assert 15 < sum(index < 50 for index in first_half) < 35


@pytest.mark.parametrize("world_size", [2, 3, 7])
def test_processes_share_a_mixed_epoch(world_size: int) -> None:
    parts = [(10, 1.0), (6, 1.5)]
    chosen = [index for rank in range(world_size) for index in shown(parts, 2, rank, world_size)]
    assert len(chosen) == -(-19 // world_size) * world_size
    extra = Counter(chosen) - Counter(shown(parts, 2))
    assert sum(extra.values()) == len(chosen) - 19
    assert not Counter(shown(parts, 2)) - Counter(chosen)


@pytest.mark.parametrize("given", range(5))
@pytest.mark.parametrize("workers", [0, 1])
def test_an_epoch_goes_on_where_it_was_left(given: int, workers: int, item: dict[str, Any]) -> None:
    whole = order(module_of(item).train_dataloader(), epoch=2)
    cut, resumed = module_of(item), module_of(item)
    cut.workers = resumed.workers = workers
    batches = iter(cut.train_dataloader())
    for _ in range(given):
        next(batches)
    assert cut.state_dict() == {"batches": given % 4}
    resumed.load_state_dict(cut.state_dict())
    loader = resumed.train_dataloader()
    assert len(loader) == 4
    assert order(loader, epoch=2) == whole[3 * (given % 4) :]
    assert order(loader, epoch=3) == order(module_of(item).train_dataloader(), epoch=3)


def test_the_epoch_is_told_after_the_loader_has_begun(item: dict[str, Any]) -> None:
    """Lightning makes the iterator first."""
    module = module_of(item)
    module.workers = 1
    loader = module.train_dataloader()
    batches = iter(loader)
    loader.batch_sampler.sampler.set_epoch(5)  # type: ignore[union-attr]
    found = [number for batch in batches for number in batch["frame"].tolist()]
    assert found == order(module_of(item).train_dataloader(), epoch=5)


def send_to_all(workers: Sequence[BaseProcess]) -> None:
    """As a scheduler does: by a process that is not the workers' parent."""
    script = "import os, sys; [os.kill(int(p), int(s)) for s in sys.argv[1].split() for p in sys.argv[2:]]"
    numbers = " ".join(str(int(s)) for s in (signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGINT))
    subprocess.run([sys.executable, "-c", script, numbers, *(str(w.pid) for w in workers)], check=True)


class SlowToStart:
    """While it is referred to, each process that is forked sleeps before it runs anything of ours."""

    def __init__(self) -> None:
        multiprocessing.util.register_after_fork(self, lambda _: time.sleep(2))


def test_workers_outlive_signals_that_come_before_they_have_started(item: dict[str, Any]) -> None:
    module = module_of(item)
    module.workers = 2
    slow = SlowToStart()
    before = set(multiprocessing.active_children())
    batches = iter(SteadyLoader(module.frames["train"], num_workers=2))
    send_to_all(sorted(set(multiprocessing.active_children()) - before, key=lambda worker: worker.name))
    assert len([*batches]) == 11
    del slow


def test_workers_outlive_the_signals_that_tell_a_training_to_save(item: dict[str, Any]) -> None:
    module = module_of(item)
    module.workers = 2
    loader = module.train_dataloader()
    batches = iter(loader)
    first = next(batches)
    workers = multiprocessing.active_children()
    assert len(workers) >= 2
    send_to_all(workers)
    rest = [number for batch in batches for number in batch["frame"].tolist()]
    assert sorted(first["frame"].tolist() + rest) == list(range(11))
    assert all(worker.is_alive() for worker in workers)
    for worker in workers:
        worker.terminate()  # by their parent
        worker.join(timeout=20)
        assert worker.exitcode == 0

"""Sums that are kept and taken up are those that were never put down; processes add up."""

import torch
from torch import Tensor

from col3d.training.tasks.epoch_totals import EpochTotals

CPU = torch.device("cpu")


def alone(sums: Tensor) -> Tensor:
    return sums


def test_means_weigh_batches_and_counts_add_up() -> None:
    totals = EpochTotals()
    totals.add({"loss": torch.tensor(1.0)}, 3)
    totals.add({"loss": torch.tensor(5.0)}, 1)
    totals.count("empty", torch.tensor(2))
    totals.count("empty", torch.tensor(1))
    assert {name: value.item() for name, value in totals.compute(alone).items()} == {"loss": 2.0, "empty": 3}
    totals.reset()
    assert totals.compute(alone) == {}


def test_taken_up_they_are_the_same_to_the_bit() -> None:
    values = torch.rand(10, generator=torch.Generator().manual_seed(0))
    whole, first, second = EpochTotals(), EpochTotals(), EpochTotals()
    for value in values:
        whole.add({"loss": value}, 2)
    for value in values[:4]:
        first.add({"loss": value}, 2)
    second.load(first.state(alone), True, CPU)
    for value in values[4:]:
        second.add({"loss": value}, 2)
    assert torch.equal(second.compute(alone)["loss"], whole.compute(alone)["loss"])


def test_of_several_processes_one_takes_up_all() -> None:
    kept = EpochTotals()
    kept.add({"loss": torch.tensor(4.0)}, 2)
    ranks = [EpochTotals(), EpochTotals()]
    for rank, totals in enumerate(ranks):
        totals.load(kept.state(alone), rank == 0, CPU)
        totals.add({"loss": torch.tensor(1.0)}, 1)
    both = ranks[0].compute(lambda sums: sums + ranks[1].sums["loss"])
    assert both["loss"].item() == (4 * 2 + 1 + 1) / 4


def test_what_is_taken_up_goes_where_processes_reduce() -> None:
    totals = EpochTotals()
    totals.load({"loss": torch.ones(2, dtype=torch.float64)}, True, torch.device("meta"))
    assert totals.sums["loss"].device.type == "meta"

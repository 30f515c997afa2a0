"""Callbacks that wait for hooks of a test are told that there is none."""

from typing import Any

from lightning import Callback
from lightning.pytorch.callbacks import DeviceStatsMonitor, EarlyStopping

from col3d.training.callbacks.named import unheard


class Watches(Callback):
    def on_test_start(self, *given: Any) -> None: ...

    def on_test_batch_end(self, *given: Any) -> None: ...


class Trains(Callback):
    def on_train_start(self, *given: Any) -> None: ...


def test_what_never_happens_is_said_of_callbacks_of_others() -> None:
    (line,) = unheard([Watches(), Trains(), DeviceStatsMonitor(), EarlyStopping("val/abs_rel")])
    assert line.startswith("note: Watches: on_test_")
    assert "on_test_start" in line
    assert "on_test_batch_end" in line
    assert "never happens" in line

"""The folder of a run: what lies there already, and what may be replaced."""

import pickle
import shutil
from pathlib import Path
from typing import Any

import torch
import yaml

from col3d.app.config import TrainOptions
from col3d.app.results import read_summary
from col3d.checks import UserError

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"
UNRELATED = {"overwrite", "output_dir", "logger"}
"""Groups and options that change nothing in the weights and numbers of a run."""
UNRELATED_INSIDE = {("data", "workers"), ("data", "store")}


class RunFolder:
    """A folder that holds nothing yet, the finished run of these options, or one that was cut off.

    Args:
        options: of the run that is asked for.

    Raises:
        UserError: the folder holds something else: the run of other options, while overwrite is not set, or
            files that are no run's.
    """

    def __init__(self, options: TrainOptions) -> None:
        self.options, self.path = options, Path(options.output_dir)
        if (self.path / CHECKPOINTS).exists() and not (self.path / CONFIG).is_file():
            raise UserError(f"{self.path} holds {CHECKPOINTS} of something else; give another hydra.run.dir")
        found = None if options.overwrite else read_summary(self.path)
        self.epoch: int | None = None
        self.cut_off = None if options.overwrite or found else self._last_checkpoint()
        if (found or self.cut_off) and (changed := self._changes()):
            raise UserError(
                f"{self.path} holds a run with another {', '.join(changed)}; "
                "give overwrite=true to replace it, or another hydra.run.dir"
            )
        self.finished: dict[str, Any] | None = found

    def begin(self) -> None:
        """Clear away what is to be replaced and write config.yaml; a run that was cut off keeps its files."""
        self.path.mkdir(parents=True, exist_ok=True)
        if self.cut_off is None:
            (self.path / "summary.json").unlink(missing_ok=True)
            for name in (CHECKPOINTS, "panels"):
                shutil.rmtree(self.path / name, ignore_errors=True)
        else:
            print(f"goes on from {self.cut_off}", flush=True)
        partial = self.path / f"{CONFIG}.partial"
        partial.write_text(yaml.safe_dump(self.options.model_dump(), sort_keys=False), encoding="utf-8")
        partial.replace(self.path / CONFIG)

    def _last_checkpoint(self) -> Path | None:
        """The newest checkpoint that can be read: one that was cut off while it was saved cannot."""
        for name in ("last.ckpt", "best.ckpt"):
            path = self.path / CHECKPOINTS / name
            if path.is_file():
                try:
                    self.epoch = int(torch.load(path, map_location="cpu", weights_only=True)["epoch"])
                except (RuntimeError, OSError, EOFError, ValueError, KeyError, pickle.UnpicklingError):
                    print(f"note: {path} was cut off while it was saved and is left aside", flush=True)
                else:
                    return path
        return None

    def _changes(self) -> list[str]:
        """Options that differ from those of the run in this folder, and matter."""
        config = self.path / CONFIG
        before = yaml.safe_load(config.read_text(encoding="utf-8")) if config.is_file() else None
        return _differing(before or {}, self.options.model_dump())


def _differing(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    names = []
    for name in sorted((before.keys() | now.keys()) - UNRELATED):
        old, new = before.get(name), now.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            inner = (k for k in sorted(old.keys() | new.keys()) if old.get(k) != new.get(k))
            names += [f"{name}.{k}" for k in inner if (name, k) not in UNRELATED_INSIDE]
        elif old != new:
            names.append(name)
    return names

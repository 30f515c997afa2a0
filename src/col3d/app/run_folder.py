"""The folder of a run: what lies there already, and what may be replaced."""

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from col3d.app.checkpoints import DamagedError, check_bytes, read_checkpoint
from col3d.app.config import TrainOptions
from col3d.app.metrics_file import ROWS
from col3d.callbacks import BestCheckpoint
from col3d.checks import UserError
from col3d.reports.jobs import RESULT, STATUS, read_plain
from col3d.reports.summary import write_json

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"
OURS = (RESULT, STATUS, "summary.json", "per_frame.csv", "metrics.csv", "bad_batch.pt", "wandb_id.txt")
UNRELATED = {"overwrite", "output_dir", "logger", "objective"}
"""Groups and options that change nothing in the weights and numbers of a run."""
UNRELATED_INSIDE = {("data", "workers"), ("data", "store"), ("callbacks", "checkpoint_minutes")}


class RunFolder:
    """A folder that holds nothing yet, the finished run of these options, or one that was cut off.

    Args:
        options: of the run that is asked for.

    Attributes:
        finished: what result.json says of the finished run of these options.
        cut_off: the checkpoint to go on from.
        rows: of metrics.csv, of the epochs that it has behind it.

    Raises:
        UserError: the folder holds something else: the run of other options, while overwrite is not set, or
            files that are no run's.
    """

    def __init__(self, options: TrainOptions) -> None:
        self.options, self.path = options, Path(options.output_dir)
        self.finished: dict[str, Any] = {}
        self.cut_off: Path | None = None
        self.rows: list[dict[str, Any]] = []
        if (self.path / CHECKPOINTS).exists() and not (self.path / CONFIG).is_file():
            raise UserError(f"{self.path} holds {CHECKPOINTS} of something else; give another hydra.run.dir")
        if not options.overwrite:
            self._look()

    def begin(self) -> None:
        """Clear away what is to be replaced and write config.yaml; a run that was cut off keeps its files."""
        self.path.mkdir(parents=True, exist_ok=True)
        if self.cut_off is None:
            for name in OURS:
                (self.path / name).unlink(missing_ok=True)
            for name in (CHECKPOINTS, "panels", "predictions_test"):
                shutil.rmtree(self.path / name, ignore_errors=True)
        else:
            print(f"goes on from {self.cut_off}", flush=True)
        partial = self.path / f"{CONFIG}.partial"
        partial.write_text(
            yaml.safe_dump(self.options.model_dump(mode="json"), sort_keys=False), encoding="utf-8"
        )
        partial.replace(self.path / CONFIG)

    def finish(self, best: dict[str, float], metrics: dict[str, float], seconds: float) -> None:
        """Write result.json, by which the run is known to be finished."""
        content = {"hash": hash_of(self.options), "best": best, "metrics": metrics, "seconds": seconds}
        write_json(self.path / RESULT, content)

    def _look(self) -> None:
        result = read_plain(self.path / RESULT)
        if result.get("hash") == hash_of(self.options):
            self.finished = result
            return
        checkpoint, content = (None, {}) if result else self._last_checkpoint()
        if (result or checkpoint) and (changed := self._changes(content)):
            raise UserError(
                f"{self.path} holds a run with another {', '.join(changed)}; "
                "give overwrite=true to replace it, or another hydra.run.dir"
            )
        if checkpoint is not None:
            self.cut_off, self.rows = checkpoint, content[ROWS]

    def _last_checkpoint(self) -> tuple[Path | None, dict[str, Any]]:
        """The newest checkpoint that is whole, if the best that it speaks of is, too."""
        for name in ("last.ckpt", "best.ckpt"):
            path = self.path / CHECKPOINTS / name
            if not path.is_file():
                continue
            try:
                content = read_checkpoint(path)
            except DamagedError as error:
                print(f"note: damaged, and left aside: {error}", flush=True)
                continue
            if name == "best.ckpt" or self._has_best(content):
                return path, content
            print("note: the best epoch's weights are lost; training starts anew to find them", flush=True)
            break
        return None, {}

    def _has_best(self, content: dict[str, Any]) -> bool:
        """Whether the best checkpoint is there, where there has been one."""
        known = [v for k, v in content["callbacks"].items() if k.startswith(BestCheckpoint.__name__)]
        if not known or known[0]["best_model_score"] is None:
            return True
        try:
            check_bytes(self.path / CHECKPOINTS / "best.ckpt")
        except (OSError, DamagedError):
            return False
        return True

    def _changes(self, content: dict[str, Any]) -> list[str]:
        """Options that differ from those of the run in this folder, and matter."""
        before = content.get("hyper_parameters", {}).get("options")
        if before is None:  # config.yaml may be damaged, a checkpoint has been checked
            with suppress(OSError, ValueError, yaml.YAMLError):
                before = yaml.safe_load((self.path / CONFIG).read_text(encoding="utf-8"))
        return _differing(before if isinstance(before, dict) else {}, self.options.model_dump(mode="json"))


def hash_of(options: TrainOptions) -> str:
    """Of all options that the weights and numbers of a run depend on."""
    content = options.model_dump(mode="json", exclude=UNRELATED)
    for group, name in UNRELATED_INSIDE:
        content[group].pop(name)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


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

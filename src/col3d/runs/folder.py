"""The folder of a run: detect a finished or interrupted run in it, and protect what may not be replaced."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from col3d.errors import UserError
from col3d.io.atomic import write_whole
from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.io.predictions import INDEX, owned_predictions
from col3d.io.run_files import RESULT, STATUS, TRAINING, read_plain
from col3d.reports.run_page import PAGE
from col3d.runs.checkpoint_callbacks import BestCheckpoint
from col3d.runs.checkpoints import DamagedError, read_checkpoint, run_of
from col3d.runs.identity import differing, hash_of
from col3d.runs.loggers import ID, MLFLOW_ID
from col3d.runs.metrics_file import ROWS
from col3d.runs.overwriting import is_replaced
from col3d.runs.request import RunRequest
from col3d.runs.starts import STARTS, Start, Starts

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"
PREDICTIONS = "predictions_test"
EPOCHS = "trainer.max_epochs"
KIND, OPTION = TRAINING, "hydra.run.dir"
BEST, LAST = f"{CHECKPOINTS}/best.ckpt", f"{CHECKPOINTS}/last.ckpt"
FILES = (
    *(RESULT, STATUS, CONFIG, STARTS, "summary.json", "per_frame.csv", "metrics.csv", "bad_batch.pt"),
    *(ID, MLFLOW_ID, PAGE, BEST, LAST),
)
DECORATIONS = ("cost", "panels", PAGE)
"""Optional outputs, which are made after the result and can be made again."""


class RunFolder:
    """The folder of a run: without a run, with the finished run of these options, or with an interrupted one.

    Args:
        request: the requested run.

    Attributes:
        request: the requested run.
        path: path of the folder.
        finished: content of result.json, if the run of these options is finished; else empty.
        cut_off: the checkpoint to go on from, if the run was interrupted.
        rows: rows of metrics.csv of the epochs before that checkpoint.
        starts: the starts of the run.
        owned: the files of the run.
        longer: message about a run that goes on for more epochs than it had; else empty.

    Raises:
        UserError: the folder holds a run of other options and `overwrite` is not set, or files that this
            program did not write.
    """

    def __init__(self, request: RunRequest) -> None:
        self.request, self.path = request, request.path
        self.finished: dict[str, Any] = {}
        self.cut_off: Path | None = None
        self.rows: list[dict[str, Any]] = []
        self.longer = ""
        self.starts = Starts(self.path)
        self.owned = Owned(self.path, KIND, OPTION)
        if not self.starts.replacing:
            self._look()
        if not self.finished and self.cut_off is None:
            self._check_place()
        if request.predictions:
            owned_predictions(self.path / PREDICTIONS).check_place()

    def begin(self, start: Start) -> None:
        """Remove what is to be replaced, and write config.yaml; an interrupted run keeps its files."""
        self.owned.adopt(*FILES)
        if self.cut_off is None:
            self.starts.begin_anew()
            self.owned.remove(keep={STARTS})
            owned_predictions(self.path / PREDICTIONS).remove()
            self.owned.adopt(*FILES)
        else:
            print(f"goes on from {self.cut_off}{self.longer}", flush=True)
            say_changes(self.starts.changes(start), "the last start")
        write_whole(self.path / CONFIG, yaml.safe_dump(self.request.plain(), sort_keys=False))
        self.starts.add(start)

    def finish(self, best: dict[str, float], metrics: dict[str, float], seconds: float) -> None:
        """Write result.json, which marks the run as finished."""
        about = {"hash": hash_of(self.request.options), "run": self.starts.run}
        scores = {"best": best, "metrics": metrics}
        self.finished = {**about, "epochs": self.request.epochs, **scores, "seconds": seconds}
        self.decorated(DECORATIONS)

    def decorated(self, undone: tuple[str, ...] | list[str]) -> None:
        """Record in result.json which decorations are still to be made."""
        self.finished |= {"panels": self.request.panels, "undone": list(undone)}
        write_json(self.path / RESULT, self.finished)

    @property
    def undone(self) -> list[str]:
        """Requested decorations that the finished run lacks."""
        lacking = {str(name) for name in self.finished.get("undone") or ()}
        if self.finished.get("panels", self.request.panels) < self.request.panels:
            lacking |= {"panels", PAGE}
        names = [name for name in DECORATIONS if name in lacking]
        if self.request.predictions and not (self.path / PREDICTIONS / INDEX).is_file():
            names.append(PREDICTIONS)
        return names

    def check_best(self, content: dict[str, Any]) -> None:
        """Refuse a best checkpoint in this folder that is of another run.

        Raises:
            UserError: names the file.
        """
        run = run_of(content)
        changed = [option for option in self._changes(content) if option != EPOCHS]
        if run != self.starts.run if run is not None else changed:
            why = f"with another {', '.join(changed)}" if changed else "of the same options"
            raise UserError(
                f"{self.path / BEST} is of another run, {why}; put this run's own back, or move it away: "
                "training then starts anew"
            )

    def _look(self) -> None:
        """Set the attributes by what the folder holds; refuse a run of other options."""
        result = read_plain(self.path / RESULT)
        stays = not self.request.overwrite or is_replaced(self.path)
        if _is_result(result) and self._is_of_these_options(result) and stays:
            self.finished = result
            return
        whole = bool(result) and (self.request.overwrite or not _is_result(result))
        checkpoint, content = (None, {}) if whole else self._last_checkpoint()
        before = self._before(content)
        changed = differing(before, self.request.plain()) if result or checkpoint else []
        if changed == [EPOCHS] and checkpoint is not None and not self.request.overwrite:
            changed = self._lengthened(before)
        if self.request.overwrite:
            if _is_result(result) or "about" in content:
                self.owned.adopt(*(name for name in FILES if (self.path / name).exists()))
            if checkpoint is None or changed or before.get("overwrite") is not True:
                return  # a run begun with overwrite=true goes on instead of being replaced again
        elif changed:
            raise UserError(
                f"{self.path} holds a run with another {', '.join(changed)}; "
                "give overwrite=true to replace it, or another hydra.run.dir"
            )
        if checkpoint is not None:
            self.cut_off, self.rows = checkpoint, content[ROWS]
            self.starts.run = run_of(content) or self.starts.run

    def _is_of_these_options(self, result: dict[str, Any]) -> bool:
        """Whether a finished run is the requested one; options that it lacks count as their defaults."""
        if result["hash"] == hash_of(self.request.options):
            return True
        epochs = self.request.epochs
        return not self._changes({}) and result.get("epochs", epochs) == epochs

    def _lengthened(self, before: dict[str, Any]) -> list[str]:
        """Return the options that still differ if a run is given more epochs; set `longer` if none does."""
        had, epochs = before["trainer"]["max_epochs"], self.request.epochs
        if not isinstance(had, int) or epochs < had or not self.request.can_be_longer:
            return [EPOCHS]
        self.longer = f", for {epochs} epochs instead of {had}"
        if self.request.schedule:
            self.longer += f"; the learning rate goes on where its schedule over {epochs} epochs would be"
        if _is_result(result := read_plain(self.path / RESULT)) and "epochs" not in result:
            write_json(self.path / RESULT, {**result, "epochs": had})
        return []

    def _check_place(self) -> None:
        """Refuse to replace files that this program did not write, or that the run begins from."""
        self._check_sources()
        self.owned.check(FILES)
        if (self.path / CHECKPOINTS).exists() and not self.owned.names:
            raise UserError(f"{self.path} holds {CHECKPOINTS} of something else; give another hydra.run.dir")

    def _check_sources(self) -> None:
        """Refuse to begin from weights in this folder, which the beginning of the run removes.

        Raises:
            UserError: names the option and the file.
        """
        mine = {(self.path / name).resolve() for name in FILES}
        for option, name in self.request.weight_files.items():
            if Path(name).resolve() in mine:
                raise UserError(
                    f"{option}: {name} is a file of this very run, {self.path}, which begins anew and would "
                    "replace it; give another hydra.run.dir, or copy the file to another place"
                )

    def _last_checkpoint(self) -> tuple[Path | None, dict[str, Any]]:
        """Return the newest intact checkpoint with its content, if the best checkpoint is intact, too."""
        for name in (LAST, BEST):
            path = self.path / name
            if not path.is_file():
                continue
            try:
                content = read_checkpoint(path)
            except DamagedError as error:
                print(f"note: damaged, and left aside: {error}", flush=True)
                continue
            if name == BEST or self._has_best(content):
                return path, content
            print("note: the best epoch's weights are lost; training starts anew to find them", flush=True)
            break
        return None, {}

    def _has_best(self, content: dict[str, Any]) -> bool:
        """Whether the best checkpoint is intact and of this run, or the run has none yet."""
        known = [v for k, v in content["callbacks"].items() if k.startswith(BestCheckpoint.__name__)]
        if not known or known[0]["best_model_score"] is None:
            return True
        try:
            best = read_checkpoint(self.path / BEST)
        except (OSError, DamagedError):
            return False
        self.starts.run = run_of(content) or self.starts.run
        if not self.request.overwrite:
            self.check_best(best)
        return run_of(best) in (None, self.starts.run)

    def _changes(self, content: dict[str, Any]) -> list[str]:
        """Return the relevant options that differ from those of the run in this folder."""
        return differing(self._before(content), self.request.plain())

    def _before(self, content: dict[str, Any]) -> dict[str, Any]:
        """Read the options of the run in this folder, from a checkpoint or else from config.yaml."""
        given = content.get("hyper_parameters")
        before = given.get("options") if isinstance(given, dict) else None
        if before is None:  # unlike a verified checkpoint, config.yaml may be damaged
            with suppress(OSError, ValueError, yaml.YAMLError):
                before = yaml.safe_load((self.path / CONFIG).read_text(encoding="utf-8"))
        return self.request.completed(before) if isinstance(before, dict) else {}


def say_changes(lines: list[str], since: str) -> None:
    """Print what changed since an earlier start."""
    for line in lines:
        print(f"note: since {since}: {line}", flush=True)


def _is_result(content: dict[str, Any]) -> bool:
    """Whether a content of result.json is complete."""
    return isinstance(content.get("hash"), str) and isinstance(content.get("best"), dict)

"""The folder of a run: what lies there already, and what may be replaced."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from col3d.app.config import TrainOptions
from col3d.app.results import read_summary
from col3d.checks import UserError


class RunFolder:
    """A folder that holds nothing yet, the finished run of these options, or one that was cut off.

    Args:
        options: of the run that is asked for.

    Raises:
        UserError: the folder holds the run of other options, and overwrite is not set.
    """

    def __init__(self, options: TrainOptions) -> None:
        self.options, self.path = options, Path(options.output_dir)
        found = None if options.overwrite else read_summary(self.path)
        last = self.path / "checkpoints" / "last.ckpt"
        self.cut_off = last if last.is_file() and found is None and not options.overwrite else None
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
            for name in ("checkpoints", "panels"):
                shutil.rmtree(self.path / name, ignore_errors=True)
        else:
            print(f"goes on from {self.cut_off}", flush=True)
        text = yaml.safe_dump(self.options.model_dump(), sort_keys=False)
        (self.path / "config.yaml").write_text(text, encoding="utf-8")

    def _changes(self) -> list[str]:
        """Options that differ from those of the run in this folder."""
        config = self.path / "config.yaml"
        before = yaml.safe_load(config.read_text(encoding="utf-8")) if config.is_file() else {}
        now = self.options.model_dump()
        return [name for name in now if name != "overwrite" and now[name] != before.get(name)]

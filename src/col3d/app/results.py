"""What an evaluation leaves behind: per_frame.csv, summary.json, panels, and the table on screen."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule
from lightning.pytorch.loggers import Logger, WandbLogger

from col3d.app.config import DataOptions, SourceOptions
from col3d.app.provenance import command, commit, versions
from col3d.callbacks import ImagePanels, PerFrameTable
from col3d.data.leakage import Shared, shared_with_training
from col3d.data.splits import describe
from col3d.reports.per_frame import means
from col3d.reports.summary import print_summary, summarise, write_json

Facts = dict[str, str | int]


def facts_of(model: str, seed: int, data: DataOptions, part: str, protocol: str) -> Facts:
    """The columns that stand in every row of a table."""
    return {
        "model": model,
        "seed": seed,
        "data": _scored(data, part).name,
        "split": part,
        "protocol": protocol,
    }


class Results:
    """Callbacks that collect the results of one evaluation, and the files they end in.

    Args:
        facts: what is the same for every frame; see `facts_of`.
        folder: where the files go.
        data: the split that the part belongs to, and the size of the frames.
        frames: number of frames of each part.
        panels: how many pictures.
        average: what weighs the same in the means: frame, video or pixel.
    """

    def __init__(
        self,
        facts: Facts,
        folder: Path,
        data: DataOptions,
        frames: Mapping[str, int],
        panels: int,
        average: str = "frame",
    ) -> None:
        self.folder, self.facts, self.average = folder, facts, average
        shared = {row.video: row.worst for row in _audit(data, str(facts["split"]))}
        self.context: dict[str, Any] = {
            "split_name": _scored(data, str(facts["split"])).split.name,
            "size": list(data.size),
            "frames_by_split": dict(frames),
            "shared_with_training": shared,
        }
        self.table = PerFrameTable(folder / "per_frame.csv", self.facts, describe)
        self.panels = ImagePanels(folder / "panels", panels)
        self.callbacks: list[Callback] = [self.table, self.panels]

    def write(
        self,
        task: LightningModule,
        checkpoint: Path,
        best: Mapping[str, float],
        loggers: Sequence[Logger] = (),
        cost: Mapping[str, Any] | None = None,
    ) -> None:
        """Write summary.json, log to Weights & Biases, and print the table with the paths."""
        facts = {
            **self.facts,
            **self.context,
            "checkpoint": str(checkpoint),
            "best": dict(best),
            "baseline": means(self.table.baseline, self.average),
            "parameters": sum(p.numel() for p in task.get_submodule("network").parameters()),
            "cost": None if cost is None else dict(cost),
            "command": command(),
            "commit": commit(),
            "versions": versions(),
        }
        summary = summarise(self.table.rows, facts, self.average)
        for logger in loggers:
            logger.log_metrics({f"test/{name}": value for name, value in summary["metrics"].items()})
            logger.save()
            if isinstance(logger, WandbLogger) and self.panels.paths:
                logger.log_image("panels", [str(path) for path in self.panels.paths])
        write_json(self.folder / "summary.json", summary)
        print_summary(summary)
        self._print_paths(checkpoint)

    def _print_paths(self, checkpoint: Path) -> None:
        wrote = [
            self.folder / name for name in ("summary.json", "per_frame.csv", "metrics.csv", "config.yaml")
        ]
        lines = [str(path) for path in (*wrote, self.folder / "panels", checkpoint) if path.exists()]
        print("wrote", *lines, sep="\n  ", flush=True)


def print_audit(data: DataOptions, part: str) -> None:
    """Say what each video of a part shares with the videos that are trained on."""
    scored = _scored(data, part)
    if not _trained_alike(data, part):
        print(f"{part} is of another data set, {scored.name}: it shares nothing with training", flush=True)
        return
    print(f"split {scored.split.name}: what {part} shares with training", flush=True)
    for row in _audit(data, part):
        videos = row.of_video or row.of_surface or row.of_phantom or row.of_texture
        which = f" ({', '.join(videos)})" if videos else ""
        print(f"  {row.video}: {row.worst}{which}", flush=True)


def _audit(data: DataOptions, part: str) -> list[Shared]:
    trained = [entry for source in _trained_alike(data, part) for entry in source.split.train]
    return shared_with_training(trained, getattr(_scored(data, part).split, part))


def _scored(data: DataOptions, part: str) -> SourceOptions:
    return data.tested if part == "test" else data


def _trained_alike(data: DataOptions, part: str) -> list[SourceOptions]:
    """What is trained on of the data set that a part is of."""
    return [source for source in (data, *data.also.values()) if source.name == _scored(data, part).name]


def read_summary(folder: Path) -> dict[str, Any] | None:
    """The summary of a finished run, or None."""
    path = folder / "summary.json"
    if not path.is_file():
        return None
    try:
        summary: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return None
    return summary

"""Results of an evaluation: per_frame.csv, summary.json, panels, and the table on screen."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lightning.pytorch.loggers import Logger, MLFlowLogger, TensorBoardLogger, WandbLogger
from PIL import Image

from col3d.data.datasets.videos import describe
from col3d.evaluation.options import ProtocolOptions
from col3d.evaluation.panels import ImagePanels
from col3d.evaluation.per_frame_table import PerFrameTable
from col3d.evaluation.scored_part import Scored
from col3d.io.json_files import write_json
from col3d.registry import MODELS
from col3d.reports.per_frame import means
from col3d.reports.run_page import PAGE
from col3d.reports.summary import print_summary, summarise
from col3d.runs.provenance import provenance

Facts = dict[str, str | int]
SUMMARY = "summary.json"


def facts_of(model: str, seed: int, scored: Scored, protocol: str) -> Facts:
    """Return the columns that are the same in every row of a table."""
    return {
        "model": model,
        "seed": seed,
        "data": scored.source.name,
        "split": scored.part,
        "protocol": protocol,
    }


def look_of(model: str) -> dict[str, str]:
    """Return the label and colour of a network in reports, as far as it is registered with them."""
    part = MODELS.parts.get(model)
    look = {name: str(part.facts.get(name, "")) for name in ("label", "colour")} if part else {}
    return {name: value for name, value in look.items() if value}


class Results:
    """Collects the results of one evaluation, and writes its files.

    Args:
        facts: columns that are the same for every frame; see `facts_of`.
        folder: folder for the files.
        kind: kind of the output; see `Owned`.
        scored: the part of a split that is scored.
        frames: number of frames of each part.
        panels: number of pictures.
        protocol: options of the protocol.
        changed: lines about what changed between the starts of the training.
    """

    def __init__(
        self,
        facts: Facts,
        folder: Path,
        kind: str,
        scored: Scored,
        frames: Mapping[str, int],
        panels: int,
        protocol: ProtocolOptions,
        changed: Sequence[str] = (),
    ) -> None:
        self.folder, self.facts, self.average = folder, facts, protocol.average
        self.context: dict[str, Any] = {
            "split_name": scored.source.split.name,
            "size": list(scored.size),
            "frames_by_split": dict(frames),
            "shared_with_training": {row.video: row.worst for row in scored.shared},
            "changed_between_starts": list(changed),
            "scoring": protocol.in_words(),
            **({} if protocol.metrics is None else {"metrics_named": protocol.metrics}),
        }
        self.table = PerFrameTable(folder / "per_frame.csv", self.facts, describe, protocol.metrics)
        self.panels = ImagePanels(folder, kind, panels)

    def write(
        self,
        source: Path,
        parameters: int,
        best: Mapping[str, float],
        loggers: Sequence[Logger] = (),
    ) -> dict[str, Any]:
        """Write summary.json and the last row of the loggers' tables, and return the summary.

        Args:
            source: checkpoint, or folder of predictions.
            parameters: number of parameters of the network; 0 if unknown.
            best: scores of the best epoch.
            loggers: loggers of the run.

        Raises:
            UserError: no frame has a pixel of valid depth under the protocol.
        """
        facts = {
            **self.facts,
            **look_of(str(self.facts["model"])),
            **self.context,
            "checkpoint": str(source),
            "best": dict(best),
            "baseline": means(self.table.baseline, self.average, self.table.specs),
            "parameters": parameters,
            "cost": None,
            **provenance(),
        }
        summary = summarise(self.table.rows, facts, self.average, self.table.specs)
        for logger in loggers:
            self.log(logger, summary)
        write_json(self.folder / SUMMARY, summary)
        return summary

    def log(self, logger: Logger, summary: Mapping[str, Any]) -> None:
        """Pass scores and pictures to a logger."""
        scores = {f"test/{name}": value for name, value in summary["metrics"].items()}
        best = summary["best"]
        logger.log_metrics({**scores, **({"epoch": best["epoch"]} if "epoch" in best else {})})
        logger.save()
        _show_pictures(logger, self.panels.paths)

    def show(self, summary: Mapping[str, Any], checkpoint: Path | None = None) -> None:
        """Print the table and the paths of the files, with the checkpoint of a training."""
        print_summary(summary)
        wrote = [
            self.folder / name for name in (PAGE, SUMMARY, "per_frame.csv", "metrics.csv", "config.yaml")
        ]
        wrote += [self.folder / "panels", *([] if checkpoint is None else [checkpoint])]
        lines = [str(path) for path in wrote if path.exists()]
        print("wrote", *lines, sep="\n  ", flush=True)


def _show_pictures(logger: Logger, paths: Sequence[Path]) -> None:
    """Pass pictures to a logger that accepts them."""
    if isinstance(logger, WandbLogger) and paths:
        logger.log_image("panels", [str(path) for path in paths])
    for path in paths:
        if isinstance(logger, TensorBoardLogger):
            picture = np.array(Image.open(path, formats=["PNG"]))
            logger.experiment.add_image(f"panels/{path.stem}", picture, dataformats="HWC")
        elif isinstance(logger, MLFlowLogger):
            logger.experiment.log_artifact(logger.run_id, str(path), "panels")

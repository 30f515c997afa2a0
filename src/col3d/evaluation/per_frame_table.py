"""Table of the metrics of every scored frame, written to `per_frame.csv`."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import torch
from torch import Tensor

from col3d.batch import Batch
from col3d.metrics import registered_specs
from col3d.reports.per_frame import PIXELS, write_per_frame

Row = dict[str, str | int | float]


class PerFrameTable:
    """Table with one row for each frame.

    Args:
        path: path of the file.
        facts: columns that are the same for all rows: model, seed, data, split, protocol.
        describe: function video -> (segment, texture).
        metrics: names of the metrics; all but those that have to be named when absent.
    """

    def __init__(
        self,
        path: Path,
        facts: Mapping[str, str | int],
        describe: Callable[[str], tuple[str, str]],
        metrics: Sequence[str] | None = None,
    ) -> None:
        self.path, self.facts, self.describe = path, dict(facts), describe
        self.specs = registered_specs(names=metrics)
        self.rows: list[Row] = []
        self.baseline: list[Row] = []

    def add(self, batch: Batch, scored: Mapping[str, Tensor], scored_baseline: Mapping[str, Tensor]) -> None:
        """Add the frames of a batch, with their metrics and those of the baseline."""
        values, baseline = (
            {name: per_frame.tolist() for name, per_frame in metrics.items()}
            for metrics in (scored, scored_baseline)
        )
        pixels = scored.get("pixels", batch["mask"].flatten(1).sum(dim=1))
        uncounted = {
            "depth": (pixels == 0).tolist(),
            "normals": (scored.get("normal_pixels", pixels) == 0).tolist(),
        }
        for i, (video, frame) in enumerate(zip(batch["video"], batch["frame"].tolist(), strict=True)):
            segment, texture = self.describe(video)
            where = {**self.facts, "video": video, "segment": segment, "texture": texture, "frame": frame}
            without = {task for task, flags in uncounted.items() if flags[i]}
            count = {PIXELS: values[PIXELS][i]} if PIXELS in values else {}
            self.rows.append({**where, **self._measured(values, i, without), **count})
            self.baseline.append({**where, **self._measured(baseline, i, without), **count})

    def _measured(self, values: Mapping[str, list[float]], index: int, without: set[str]) -> Row:
        """Select the metrics of one frame, without those that it has no value of."""
        measured = {name: values[name][index] for name in self.specs if name in values}
        return {
            name: value
            for name, value in measured.items()
            if not (math.isnan(value) and (self.specs[name].undefined or self.specs[name].task in without))
        }

    def gather(self) -> None:
        """Collect the rows of all processes, in the order of videos and frames."""
        if torch.distributed.is_initialized():
            self.rows, self.baseline = _gather(self.rows), _gather(self.baseline)
        for rows in (self.rows, self.baseline):
            rows.sort(key=lambda row: (row["video"], row["frame"]))

    def save(self) -> None:
        """Write the table."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_per_frame(self.path, self.rows, self.specs)


def _gather(rows: list[Row]) -> list[Row]:
    gathered: list[list[Row]] = [[] for _ in range(torch.distributed.get_world_size())]
    torch.distributed.all_gather_object(gathered, rows)
    return [row for part in gathered for row in part]

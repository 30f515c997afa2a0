"""The part of a split that is scored, and the audit of what it shares with the training data."""

from collections.abc import Sequence
from dataclasses import dataclass

from col3d.data.leakage import Shared, shared_with_training
from col3d.data.options import DataOptions, SourceOptions


@dataclass(frozen=True)
class Scored:
    """A part of the split of a data set.

    Attributes:
        source: the data set.
        part: train, val or test.
        size: size of the frames.
        trained: all data sets of the training.
    """

    source: SourceOptions
    part: str
    size: Sequence[int]
    trained: tuple[SourceOptions, ...]

    @classmethod
    def after(cls, data: DataOptions, part: str) -> "Scored":
        """Make the description of a part that is scored after a training on these data."""
        source = data.tested if part == "test" else data
        return cls(source, part, data.size, (data, *data.also.values()))

    @property
    def shared(self) -> list[Shared]:
        """What each scored video shares with the training videos; empty for another data set."""
        entries = [entry for source in self._alike for entry in source.split.train]
        return shared_with_training(entries, getattr(self.source.split, self.part)) if entries else []

    def print_audit(self) -> None:
        """Print the train/test leakage audit: what the scored part shares with the training videos."""
        if not self._alike:
            trained = " and ".join(source.name for source in self.trained)
            print(f"{self.part} is of {self.source.name}, of which nothing was trained on ({trained} was)")
            return
        print(f"split {self.source.split.name}: what {self.part} shares with training", flush=True)
        rows = self.shared
        if len(rows) > 1 and {row.worst for row in rows} == {"nothing"}:
            print(f"  each of its {len(rows)} videos: nothing", flush=True)
            return
        for row in rows:
            videos = row.of_video or row.of_surface or row.of_phantom or row.of_texture
            which = f" ({', '.join(videos)})" if videos else ""
            print(f"  {row.video}: {row.worst}{which}", flush=True)

    @property
    def _alike(self) -> list[SourceOptions]:
        """Training data of the same data set."""
        return [source for source in self.trained if source.name == self.source.name]

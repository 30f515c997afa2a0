"""Notes below a table: missing metrics, partial means and the kinds of intervals."""

from dataclasses import dataclass, field

from col3d.reports.statistics import Interval


@dataclass
class Notes:
    """Collects the notes below a table, such as metrics that its rows lack."""

    missing: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    partial: dict[tuple[str, int, int], list[str]] = field(default_factory=dict)
    over: dict[str, list[str]] = field(default_factory=dict)
    more: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """The notes as sentences."""
        partial = [
            f"{row}: {lacking} of {frames} frames have no {', '.join(metrics)} and are not in its mean."
            for (row, lacking, frames), metrics in self.partial.items()
        ]
        return [*self._intervals(), *self._missing(), *partial, *self.more]

    def lacks(self, row: str, runs: str, metric: str) -> None:
        """Record that runs of a row do not have a metric that others have."""
        metrics = self.missing.setdefault(row, {}).setdefault(runs, [])
        metrics += [metric] if metric not in metrics else []

    def lacks_in(self, row: str, lacking: int, frames: int, metric: str) -> None:
        """Record that some frames of a row do not have a metric."""
        metrics = self.partial.setdefault((row, lacking, frames), [])
        metrics += [metric] if metric not in metrics else []

    def add(self, note: str) -> None:
        """Add a sentence, once."""
        if note not in self.more:
            self.more.append(note)

    def interval(self, row: str, interval: Interval | None) -> None:
        """Record what the intervals of a row are over."""
        rows = self.over.setdefault("" if interval is None else interval.over, [])
        if row not in rows:
            rows.append(row)

    def _missing(self) -> list[str]:
        """Metrics that runs lack, a sentence for all rows that lack the same."""
        alike: dict[tuple[str, ...], list[tuple[str, str]]] = {}
        for row, lacks in self.missing.items():
            for runs, metrics in lacks.items():
                alike.setdefault(tuple(metrics), []).append((row, runs))
        return [
            f"{', '.join(row for row, _ in pairs)}: {', '.join(metrics)} left empty, for per_frame.csv of "
            f"{', '.join(runs for _, runs in pairs)} does not have it."
            for metrics, pairs in alike.items()
        ]

    def _intervals(self) -> list[str]:
        sentences = []
        for over, rows in self.over.items():
            whose = "" if len(self.over) == 1 else f" ({', '.join(rows)})"
            alone = {"videos": ", there being one seed", "seeds": ", there being one video"}.get(over, "")
            sentences.append(
                f"Intervals{whose}: over {over}{alone}."
                if over
                else f"No interval{whose}: one video and one seed."
            )
        return sentences

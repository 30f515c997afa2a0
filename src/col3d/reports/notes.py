"""What a reader has to know of the cells of a table."""

from dataclasses import dataclass, field

from col3d.reports.statistics import Interval


@dataclass
class Notes:
    """Collects what a reader has to know of the cells of a table."""

    missing: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    over: dict[str, list[str]] = field(default_factory=dict)
    more: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """As sentences."""
        missing = [
            f"{row}: {', '.join(metrics)} left empty, for per_frame.csv of {runs} does not have it."
            for row, lacks in self.missing.items()
            for runs, metrics in lacks.items()
        ]
        return [*self._intervals(), *missing, *self.more]

    def add(self, note: str) -> None:
        """Remember a sentence, once."""
        if note not in self.more:
            self.more.append(note)

    def interval(self, row: str, interval: Interval | None) -> None:
        """Remember what the intervals of a row are over."""
        rows = self.over.setdefault("" if interval is None else interval.over, [])
        if row not in rows:
            rows.append(row)

    def _intervals(self) -> list[str]:
        said = []
        for over, rows in self.over.items():
            whose = "" if len(self.over) == 1 else f" ({', '.join(rows)})"
            alone = {"videos": ", there being one seed", "seeds": ", there being one video"}.get(over, "")
            said.append(
                f"Intervals{whose}: over {over}{alone}."
                if over
                else f"No interval{whose}: one video and one seed."
            )
        return said

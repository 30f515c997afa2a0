"""Setting of an evaluation: the data, split, protocol, size and frames that all runs of a table share."""

import hashlib
import json
from dataclasses import dataclass, field

from col3d.reports.options import at
from col3d.reports.runs import Run


@dataclass(frozen=True)
class Setting:
    """Equal for runs that were trained on the same videos and scored on the same frames in the same way.

    Attributes:
        digest: short hash of the lists of videos and of the frames that were scored.
        scoring: mask and alignment of the protocol in words; empty for earlier runs.
    """

    data: str
    split: str
    part: str
    protocol: str
    average: str
    size: str
    frames: int
    videos: int
    digest: str
    scoring: str = field(default="", compare=False)

    def __str__(self) -> str:
        return (
            f"{self.data}, split {self.split}, {self.part} part, protocol {self.protocol}, size {self.size}, "
            f"{self.frames} frames of {self.videos} video{'s' if self.videos > 1 else ''}{self.scoring}"
        )

    @property
    def named(self) -> str:
        """Text with the digest, for two settings may differ by nothing else."""
        return f"{self}, list {self.digest}"


def setting_of(run: Run) -> Setting:
    """The setting that a run was scored in."""
    recorded = at(run.summary, "size") or at(run.summary, "cost.size")
    size = recorded or at(run.options, "data.size") or ("unknown",)
    scored = list(zip(run.frames["video"].tolist(), run.frames["frame"].tolist(), strict=True))
    lists = json.dumps([at(run.options, "data.split"), scored], sort_keys=True)
    words = at(run.summary, "scoring") or {}
    return Setting(
        data=str(run.summary["data"]),
        split=str(run.summary["split_name"]),
        part=str(run.summary["split"]),
        protocol=str(run.summary["protocol"]),
        average=str(run.summary.get("average", "frame")),
        size=" x ".join(map(str, size)),
        frames=len(scored),
        videos=len({video for video, _ in scored}),
        digest=hashlib.sha1(lists.encode()).hexdigest()[:6],
        scoring="".join(f"; {name}: {words[name]}" for name in ("mask", "alignment") if name in words),
    )

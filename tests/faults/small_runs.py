"""One small run of each command: what it is given, what was there before, and what it ends in."""

import csv
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from col3d.cli.program import composed
from tests.faults.injector import Injector
from tests.faults.trial import OPTIONS

MINE = "precious"
"""What files of others hold, which lie everywhere."""
EVALUATED = "trained/predictions_"
"""What an evaluation keeps beside the run that it scores."""
PREVIEWS = (".png", ".mp4", ".html", ".npz")
"""Endings of files whose bytes hold the time, are of no weight, or differ from run to run."""
TIMES = ("seconds",)
"""Columns of tables that differ from run to run."""


@dataclass(frozen=True)
class SmallRun:
    """A run of a command in a place that holds frames, a finished training and files of others.

    Attributes:
        name: of the command.
        options: from the place to what the command is given.
        output: of the command, in the place.
        mark: the file in the output by which it looks finished.
        ready: puts there what is to be there first.
        beside: folders of the output where files of others lie.
    """

    name: str
    options: Callable[[Path], Any]
    output: str
    mark: str
    ready: Callable[[Path], None] = lambda place: None
    beside: tuple[str, ...] = ("",)

    def given(self, place: Path) -> Any:
        """What the command is called with."""
        return self.options(place)

    def make_ready(self, place: Path) -> None:
        """Put files of others into the output, and whatever is to be there."""
        self.ready(place)
        for folder in self.beside:
            (place / self.output / folder).mkdir(parents=True, exist_ok=True)
            (place / self.output / folder / "mine.csv").write_text(MINE)

    def others(self, place: Path) -> dict[str, str]:
        """All files that are not the command's own, by their bytes."""
        return {
            name: _digest(path)
            for name, path in _files(place)
            if path.name == "mine.csv" or not name.startswith((self.output, EVALUATED))
        }

    def result(self, place: Path) -> dict[str, str]:
        """What of the command's own files has to be the same each time."""
        found = {}
        for name, path in _files(place):
            hidden = path.name.startswith(".") or ".partial" in path.name or path.name == "mine.csv"
            if (
                name.startswith(self.output)
                and not hidden
                and path.name not in ("status.json", "starts.json")
            ):
                found[name] = _essence(path)
        return found

    def looks_finished(self, place: Path) -> bool:
        """Whether the mark is there, and says of nothing that it is undone."""
        mark = place / self.output / self.mark
        return mark.is_file() and not json.loads(mark.read_text()).get("undone")


def _files(place: Path) -> list[tuple[str, Path]]:
    return [(str(path.relative_to(place)), path) for path in sorted(place.rglob("*")) if path.is_file()]


def _digest(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=8).hexdigest()


def _essence(path: Path) -> str:
    """What of a file two runs have in common."""
    if path.suffix in PREVIEWS:
        return "there"
    try:
        content = READ.get(path.suffix, Path.read_bytes)(path)
    except Exception as error:  # whatever is wrong with it, it is another result
        return f"broken: {type(error).__name__}"
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def _weights(path: Path) -> bytes:
    state = torch.load(path, weights_only=True)["state_dict"]
    return b"".join(values.contiguous().numpy().tobytes() for values in state.values())


def _facts(path: Path) -> bytes:
    content = json.loads(path.read_text())
    return json.dumps([content.get(key) for key in ("metrics", "best", "frames", "comparisons")]).encode()


def _rows(path: Path) -> bytes:
    with path.open(newline="") as file:
        rows = [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]
    return json.dumps(rows).encode()


READ: dict[str, Callable[[Path], bytes]] = {".ckpt": _weights, ".json": _facts, ".csv": _rows}


def _composed(config: str, *overrides: str) -> dict[str, Any]:
    return composed(config, overrides)


def _train(place: Path, run: str = "run") -> dict[str, Any]:
    epochs = [
        option for option in OPTIONS if not option.startswith(("trainer.max_epochs", "callbacks.check"))
    ]
    folders = (f"data.root={place / 'frames'}", f"output_dir={place / run}", "trainer.max_epochs=1")
    return _composed("train", *epochs, *folders)


def _of_weights(config: str, place: Path, *overrides: str) -> dict[str, Any]:
    checkpoint = f"checkpoint={place / 'trained' / 'checkpoints' / 'best.ckpt'}"
    accelerator = () if config == "export" else ("accelerator=cpu",)
    return _composed(config, checkpoint, *accelerator, *overrides)


def _prepare(place: Path) -> dict[str, Any]:
    """One colon of its own seed: of those of C3VD all would be rendered."""
    folders = (f"data.root={place}/prepared/frames", f"prepare.out={place}/prepared/store", "workers=1")
    parts = [f"data.split.{part}=[desc_t4_a_s1]" for part in ("train", "val", "test")]
    sizes = ("data.size=[64,80]", "phantom.size=[64,80]", "phantom.frames_per_video=2")
    return _composed("prepare", "data/split=custom", *parts, *sizes, *folders)


def _exported_before(place: Path) -> None:
    (place / "exported").mkdir(exist_ok=True)
    earlier: dict[str, Any] = {"state_dict": {}, "hyper_parameters": {}, "about": {}}
    torch.save(earlier, place / "exported" / "net.ckpt")


def _evaluate(place: Path) -> dict[str, Any]:
    return _of_weights("evaluate", place, f"output_dir={place / 'scored'}", "panels=1")


def _predict(place: Path) -> dict[str, Any]:
    folders = (f"input={place / 'frames' / 'desc_t4_a'}", f"output={place / 'predicted'}")
    return _of_weights("predict", place, *folders, "camera=c3vd", "previews=true")


def _export(place: Path) -> dict[str, Any]:
    return _of_weights("export", place, f"output={place / 'exported' / 'net.ckpt'}", "overwrite=true")


def _fuse(place: Path) -> dict[str, Any]:
    folders = (f"video={place / 'frames' / 'desc_t4_a'}", f"output={place / 'fused'}")
    return _of_weights("fuse", place, *folders, "voxel=2")


def _report(place: Path) -> list[str]:
    return [str(place / "trained"), str(place / "paper")]


RUNS = (
    SmallRun("train", _train, "run", "result.json", beside=("", "panels")),
    SmallRun("prepare", _prepare, "prepared", "store/desc_t4_a_s1/index.json", beside=()),
    SmallRun("evaluate", _evaluate, "scored", "summary.json", beside=("", "panels")),
    SmallRun("predict", _predict, "predicted", "summary.json"),
    SmallRun("export", _export, "exported", "none", _exported_before),
    SmallRun("fuse", _fuse, "fused", "fusion.json"),
    SmallRun("report", _report, "paper", "none", beside=("", "tables", "figures")),
)


def prepared_place(place: Path, injector: Injector) -> Path:
    """Frames, a finished training of them and files of others."""
    place.mkdir(parents=True)
    (place / "mine.csv").write_text(MINE)
    code, _, said = injector.run("train", _train(place, "trained"), place)
    if code:
        raise SystemExit(said)
    return place

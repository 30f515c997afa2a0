"""A metric of somebody's own package, from the command line to the report, without a line changed here."""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from programs import call
from refusals import refusal
from tiny_run import SMALL, TINY

from col3d.registry.metric_specs import OURS
from col3d.reports.per_frame import IDENTITY, read_per_frame

pytestmark = pytest.mark.end_to_end

PACKAGE = '''
"""A metric of a laboratory, and one of normals."""

from typing import Annotated

import torch
from pydantic import Field

from col3d.registry import register_metric


@register_metric("overshoot", better="lower", unit="mm", heading="Over|shoot", decimals=1)
def overshoot(preds, target, mask, *, power: Annotated[float, Field(gt=0)] = 1.0):
    """What predictions are too far, of the frames that are; odd frames have no such value."""
    gap = torch.where(mask, (preds - target).clamp(min=0), 0.0).pow(power)
    mean = gap.sum(dim=(1, 2, 3)) / mask.sum(dim=(1, 2, 3))
    return torch.where(mean > 0, mean, torch.nan)


@register_metric("facing", task="normals", better="higher", scale=100, unit="%", in_validation=False)
def facing(preds, target, mask):
    """Share of normals that face the camera."""
    return ((preds[:, 2:] < 0) & mask).sum(dim=(1, 2, 3)) / mask.sum(dim=(1, 2, 3))
'''
WRONG = PACKAGE.replace("return torch.where(mean > 0, mean, torch.nan)", "return mean.mean()")
RAISES = PACKAGE.replace("return torch.where(mean > 0, mean, torch.nan)", "raise KeyError('mine')")
OWN = ("plugins=[mylab]", "metrics.overshoot.power=2", "objective=[val/overshoot]")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mylab").mkdir()
    (tmp_path / "mylab" / "__init__.py").write_text(PACKAGE)
    return tmp_path


def report(folder: Path) -> str:
    """The report of the runs in a folder, by a program that knows no plugin."""
    command = [sys.executable, "-m", "col3d.reports", "runs", "report"]
    environment = {key: value for key, value in os.environ.items() if key != "COL3D_PLUGINS"}
    answer = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert "left out" not in answer.stdout
    return (folder / "report" / "report.md").read_text()


def as_before(run: Path, to: Path) -> None:
    """A run with other weights of its loss, as versions left it that knew fourteen metrics and no specs."""
    shutil.copytree(run, to)
    columns = [*IDENTITY, *list(OURS)[:14]]
    with (to / "per_frame.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, columns, extrasaction="ignore")
        table.writeheader()
        table.writerows(read_per_frame(run / "per_frame.csv"))
    summary = json.loads((run / "summary.json").read_text())
    old = {key: value for key, value in summary.items() if key not in ("metric_specs", "label", "colour")}
    (to / "summary.json").write_text(json.dumps(old))
    options = yaml.safe_load((run / "config.yaml").read_text())
    options["loss"]["lambdas"] = [0.4, 0.3, 0.3]
    (to / "config.yaml").write_text(yaml.safe_dump(options, sort_keys=False))


def test_a_metric_of_a_package_reaches_every_table(folder: Path, phantom_root: Path) -> None:
    run = folder / "runs" / "mine"
    given = (*TINY, SMALL, f"data.root={phantom_root}", f"output_dir={run}")
    trained = call("train.py", *given, *OWN, cwd=folder)
    assert trained.returncode == 0, trained.stderr
    assert "Over|shoot mm" in trained.stdout
    assert "facing" in trained.stdout

    rows = read_per_frame(run / "per_frame.csv")
    assert list(rows[0]) == [*IDENTITY, *OURS, "overshoot", "facing", "pixels"]
    header = (run / "metrics.csv").read_text().splitlines()[0].split(",")
    assert {"val/overshoot", "test/overshoot", "test/facing"} <= set(header)
    assert "val/facing" not in header
    summary = json.loads((run / "summary.json").read_text())
    assert summary["metric_specs"]["overshoot"] == {
        "better": "lower",
        "unit": "mm",
        "heading": "Over|shoot",
        "decimals": 1,
    }
    values = [float(row["overshoot"]) for row in rows if row["overshoot"]]
    assert summary["metrics"]["overshoot"] == pytest.approx(sum(values) / len(values))

    best = f"checkpoint={run / 'checkpoints' / 'best.ckpt'}"
    scored = call("evaluate", best, "plugins=[mylab]", f"output_dir={folder / 'scored'}", cwd=folder)
    assert scored.returncode == 0, scored.stderr
    plain = read_per_frame(folder / "scored" / "per_frame.csv")  # without the power of 2
    assert 0 < float(plain[0]["overshoot"]) < float(rows[0]["overshoot"])

    as_before(run, folder / "runs" / "before")
    text = report(folder)
    weights = text[text.index("### Weights of the loss\n") :]
    heads = next(line for line in weights.splitlines() if line.startswith("|"))
    mine = next(line for line in weights.splitlines() if line.startswith("| (0.5, 0.3, 0.2) |"))
    assert r"| Over\|shoot (mm) ↓ |" in heads
    assert "| facing (%) ↑ |" in heads
    mean = summary["metrics"]["overshoot"]
    assert f"| {mean:.1f} |" in mine
    lacks = "(0.4, 0.3, 0.3): delta_1_1, overshoot, facing left empty, for per_frame.csv of before does not"
    assert lacks in text
    further = text[text.index("### Weights of the loss: further metrics") :]
    assert "Boundary F1 ↑" in further.splitlines()[4]
    assert "MAE (mm) ↓" in further.splitlines()[4]


@pytest.mark.parametrize(
    ("package", "given", "about", "named"),
    [
        (PACKAGE, "metrics.overshoot.pwoer=2", "metrics.overshoot.pwoer", "'metrics.overshoot.power'"),
        (PACKAGE, "metrics.overshoot.power=0", "metrics.overshoot.power", "greater than 0, got 0"),
        (PACKAGE, "metrics.undershoot.power=1", "metrics", "'undershoot'"),
        (PACKAGE, "objective=[val/facing]", "objective", "val/facing "),
        (PACKAGE, "objective=[val/overshot]", "objective", "val/overshot "),
        (WRONG, "seed=0", "metric overshoot", "mylab.overshoot "),
    ],
)
def test_each_mistake_is_one_line_before_any_work(
    folder: Path, phantom_root: Path, package: str, given: str, about: str, named: str
) -> None:
    (folder / "mylab" / "__init__.py").write_text(package)
    data = f"data.root={phantom_root}"
    answer = call("train.py", *TINY, SMALL, data, "plugins=[mylab]", given, "output_dir=run", cwd=folder)
    assert answer.returncode == 2, answer.stderr
    assert refusal(answer.stderr).about == about
    assert named in answer.stderr
    assert "epoch" not in answer.stdout


def test_an_error_of_the_metric_keeps_its_traceback(folder: Path, phantom_root: Path) -> None:
    (folder / "mylab" / "__init__.py").write_text(RAISES)
    answer = call("train.py", *TINY, SMALL, f"data.root={phantom_root}", "plugins=[mylab]", cwd=folder)
    assert answer.returncode == 1
    assert "mylab/__init__.py" in answer.stderr
    assert answer.stderr.splitlines()[-1] == "KeyError: 'mine'"

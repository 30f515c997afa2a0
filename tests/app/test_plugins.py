"""A network, a loss and an optimiser of somebody's own package, without a line changed here."""

import json
from pathlib import Path

import pytest
from programs import call
from tiny_run import TINY

PACKAGE = '''
"""Parts of a laboratory."""

from typing import Annotated

import torch
from pydantic import Field
from torch import nn

from col3d.registry import register_loss, register_model, register_optimizer


@register_model("net", loss="silog")
class Net(nn.Module):
    """One convolution."""

    def __init__(self, width: Annotated[int, Field(gt=0)] = 4, max_depth: float = 100.0) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Conv2d(3, width, 3, padding=1), nn.ReLU(), nn.Conv2d(width, 1, 1))
        self.max_depth = max_depth

    def forward(self, image, rays=None):
        return {"depth": self.max_depth * self.layers(image).sigmoid(), "seen": image}


@register_loss("far")
def far(prediction, batch, *, power: float = 1.0):
    """Error of the farthest pixels."""
    gap = torch.where(batch["mask"], prediction["depth"] - batch["depth"], 0.0).abs()
    return (gap / 100.0).pow(power).mean()


@register_optimizer("half", defaults={"lr": 1e-3})
class Half(torch.optim.SGD):
    """Half a step."""

    def __init__(self, params, lr: float = 1e-2) -> None:
        super().__init__(params, lr=lr / 2)
'''
OWN = ("plugins=[mylab]", "model=net", "model.width=6", "loss.terms.far={term:far,power:2.0}")
REST = ("loss.lambdas=[1.0,0.5]", "optimizer=half", "optimizer.lr=1e-2")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mylab").mkdir()
    (tmp_path / "mylab" / "__init__.py").write_text(PACKAGE)
    return tmp_path


def test_parts_of_a_package_train_beside_ours_and_are_known_everywhere(
    folder: Path, phantom_root: Path
) -> None:
    data = f"data.root={phantom_root}"
    place = f"hydra.sweep.dir={folder / 'all'}"
    both = ("plugins=[mylab]", "model=net,bts", "loss=silog", "optimizer=half")
    sweep = call("train.py", "-m", *TINY, *both, data, place, cwd=folder)
    assert sweep.returncode == 0, sweep.stderr
    run = folder / "run"
    one = (*TINY, data, *OWN, *REST, f"hydra.run.dir={run}")
    trained = call("train.py", *one, cwd=folder)
    assert trained.returncode == 0, trained.stderr
    assert "minimises 1 silog + 0.5 far(power=2.0)" in trained.stdout
    assert "train/loss_far" in (run / "metrics.csv").read_text().splitlines()[0]
    assert json.loads((run / "starts.json").read_text())["starts"][-1]["packages"]["mylab"] == "unknown"
    again = call("train.py", *one, cwd=folder)
    assert "finished before" in again.stdout, again.stderr

    best = f"checkpoint={run / 'checkpoints' / 'best.ckpt'}"
    without = call("evaluate", best, cwd=folder)
    assert (without.returncode, without.stdout) == (2, "")
    assert "was trained with parts of mylab; add plugins=[mylab]" in without.stderr
    scored = call("evaluate", best, f"output_dir={folder / 'scored'}", cwd=folder, COL3D_PLUGINS="mylab")
    assert scored.returncode == 0, scored.stderr
    exported = call("export", best, "plugins=[mylab]", "output=net.onnx", cwd=folder)
    assert exported.returncode == 0, exported.stderr
    assert "image -> depth" in exported.stdout


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["plugins=[mylob]"], "plugins: there is no package 'mylob'"),
        (["plugins=[mylab.parts]"], "plugins: the package mylab has no module 'mylab.parts'"),
        (["plugins=[/etc]"], "plugins: there is no package '/etc'"),
        (["model=net"], "model: 'net' is unknown"),
        (
            ["plugins=[mylab]", "model=net", "model.wdith=3"],
            "model.wdith: no such option; did you mean 'model.width'",
        ),
        (["plugins=[mylab]", "model=net", "model.width=0"], "model.width: expected greater than 0, got 0"),
        (
            ["plugins=[mylab]", "loss.terms.depth.term=fur"],
            "loss.terms: 'fur' is unknown; did you mean 'far'",
        ),
        (["plugins=[mylab]", "loss.terms.x={term:far,powr:2}"], "loss.terms.x.powr: no such option"),
        (
            ["plugins=[mylab]", "optimizer=half", "+optimizer.momentum=1"],
            "optimizer.momentum: no such option",
        ),
        (
            ["plugins=[mylab]", "model=net", "model.freeze=[encoder]"],
            "model.freeze: Net has no module `encoder`",
        ),
        (
            ["plugins=[mylab]", "model=net", "model.normals=unc", "loss=mtl"],
            "model.normals: net offers no maps",
        ),
    ],
)
def test_each_mistake_is_one_line(folder: Path, given: list[str], expected: str) -> None:
    answer = call("train.py", *TINY, *given, cwd=folder)
    assert answer.returncode == 2, answer.stderr
    assert answer.stderr.startswith(f"error: {expected}")
    assert len(answer.stderr.splitlines()) == 1


def test_an_error_of_the_package_keeps_its_traceback(folder: Path) -> None:
    (folder / "mylab" / "__init__.py").write_text("import col3d\nraise ValueError('mine')\n")
    answer = call("train.py", "plugins=[mylab]", cwd=folder)
    assert answer.returncode == 1
    assert "mylab/__init__.py" in answer.stderr
    assert answer.stderr.splitlines()[-1] == "ValueError: mine"

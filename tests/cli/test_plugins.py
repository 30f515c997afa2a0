"""A network, a loss and an optimiser of somebody's own package, without a line changed here."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from programs import PROJECT, call
from refusals import refusal
from served import served
from tiny_run import TINY

pytestmark = pytest.mark.end_to_end

PACKAGE = '''
"""Parts of a laboratory."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import torch
from pydantic import Field
from torch import nn

from col3d.registry import register_callback, register_loss, register_model, register_optimizer


@register_callback("hook")
def hook(count: int = 3):
    """No callback."""
    return count


@register_model("net", loss="silog")
class Net(nn.Module):
    """One convolution."""

    def __init__(
        self,
        width: Annotated[int, Field(gt=0)] = 4,
        max_depth: float = 100.0,
        shares: Mapping[str, float] = MappingProxyType({"a": 1.0}),
        init: Path = Path("none"),
        pair: tuple[int, int] = (3, 3),
    ) -> None:
        super().__init__()
        assert isinstance(init, Path) and isinstance(pair, tuple)
        assert shares in ({"a": 1.0}, {"a": 1.0, "b": 2.0})
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
OWN = (
    "plugins=[mylab]",
    "model=net",
    "model.width=6",
    "model.shares={b:2}",
    "loss.terms.far={term:far,power:2.0}",
)
REST = ("loss.lambdas=[1.0,0.5]", "optimizer=half", "optimizer.lr=1e-2")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mylab").mkdir()
    (tmp_path / "mylab" / "__init__.py").write_text(PACKAGE)
    return tmp_path


def test_parts_of_a_package_are_known_everywhere(
    folder: Path, phantom_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, workers = f"data.root={phantom_root}", ("data.workers=1",)
    both = ("plugins=[mylab]", "model=net,bts", "loss=silog", "optimizer=half")
    jobs = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"hydra.sweep.dir={folder / 'all'}")
    sweep = call("train.py", "-m", *TINY, *both, data, *jobs, *workers, cwd=folder)
    assert sweep.returncode == 0, sweep.stderr
    assert len(list((folder / "all").glob("*/result.json"))) == 2

    run = folder / "run"
    one = (*TINY, data, *OWN, *REST, *workers, f"hydra.run.dir={run}")
    trained = call("train.py", *one, cwd=folder)
    assert trained.returncode == 0, trained.stderr
    assert "minimises 1 silog + 0.5 far(power=2.0)" in trained.stdout
    assert "train/loss_far" in (run / "metrics.csv").read_text().splitlines()[0]
    assert json.loads((run / "starts.json").read_text())["starts"][-1]["packages"]["mylab"] == "unknown"

    best = f"checkpoint={run / 'checkpoints' / 'best.ckpt'}"
    without = call("evaluate", best, cwd=folder)
    assert (without.returncode, without.stdout) == (2, "")
    assert "plugins=[mylab]" in refusal(without.stderr).message
    scored = call("evaluate", best, f"output_dir={folder / 'scored'}", cwd=folder, COL3D_PLUGINS="mylab")
    assert scored.returncode == 0, scored.stderr
    exported = call("export", best, "plugins=[mylab]", "output=net.onnx", cwd=folder)
    assert exported.returncode == 0, exported.stderr
    assert "image -> depth" in exported.stdout
    monkeypatch.setenv("COL3D_PLUGINS", "mylab")
    with served(run / "checkpoints" / "best.ckpt", folder) as address:
        assert address.startswith("http://127.0.0.1")
    monkeypatch.delenv("COL3D_PLUGINS")

    (folder / "mylab" / "__init__.py").write_text(f"{PACKAGE}\n# another line\n")
    again = call("train.py", *one, cwd=folder)
    assert "finished before" in again.stdout, again.stderr
    assert "note: since this run's last start: files of the plugin mylab changed" in again.stdout


def test_two_processes_share_the_parts_of_a_package(folder: Path, phantom_root: Path) -> None:
    split = ("data.split.train=[cecum_t1_a,trans_t1_a:0-0]", "data.batch_size=2")
    two = ("trainer=ddp", "trainer.devices=2", "trainer.accelerator=cpu", f"data.root={phantom_root}")
    answer = call("train.py", *TINY, *split, *two, *OWN, *REST, "hydra.run.dir=run", cwd=folder)
    assert answer.returncode == 0, answer.stderr
    assert (folder / "run" / "result.json").is_file()


def test_an_installed_package_needs_no_word(folder: Path) -> None:
    about = folder / "mylab-0.1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 0.1\n")
    (about / "entry_points.txt").write_text("[col3d.plugins]\nmine = mylab\n")
    listed = call("list", "models", cwd=PROJECT, PYTHONPATH=str(folder))
    assert listed.returncode == 0, listed.stderr
    assert "net " in listed.stdout
    described = call("describe", "model", "net", cwd=PROJECT, PYTHONPATH=str(folder))
    assert "model.width: int, gt=0; 4 unless given" in described.stdout


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        (["plugins=[mylob]"], "plugins", "'mylob'"),
        (["plugins=[mylab.parts]"], "plugins", "'mylab.parts'"),
        (["plugins=[/etc]"], "plugins", "'/etc'"),
        (["plugins=[random]"], "plugins", "random is a module of Python"),
        (["plugins=mylab,theirs"], "plugins", "write [mylab,theirs]"),
        (["plugins=[mylab"], "plugins", "got [mylab"),
        (["model=net"], "model", "'net'"),
        (["plugins=[mylab]", "model=net", "model.shares={a:x}"], "model.shares.a", "'x'"),
        (["plugins=[mylab]", "model=net", "model.shares.b=x"], "model.shares.b", "'x'"),
        (["plugins=[mylab]", "model=net", "model.shares=3"], "model.shares", "braces"),
        (["plugins=[mylab]", "model=net", "model.init="], "model.init", "not empty"),
        (["plugins=[mylab]", "model=net", "model.init=null"], "model.init", "got None"),
        (["plugins=[mylab]", "model=net", "model.pair=3"], "model.pair", "brackets"),
        (["plugins=[mylab]", "callbacks.more.it=hook"], "callback hook", "mylab.hook gives int"),
        (["plugins=[mylab]", "model=net", "model.wdith=3"], "model.wdith", "'model.width'"),
        (["plugins=[mylab]", "model=net", "model.width=0"], "model.width", "greater than 0, got 0"),
        (
            ["plugins=[mylab]", "loss.terms.depth.term=fur"],
            "loss.terms",
            "'fur' is unknown; did you mean 'far'",
        ),
        (["plugins=[mylab]", "loss.terms.x={term:far,powr:2}"], "loss.terms.x.powr", "no such option"),
        (
            ["plugins=[mylab]", "optimizer=half", "+optimizer.momentum=1"],
            "optimizer.momentum",
            "no such option",
        ),
        (["plugins=[mylab]", "model=net", "model.freeze=[encoder]"], "model.freeze", "Net has no module"),
        (["plugins=[mylab]", "model=net", "model.normals=unc", "loss=mtl"], "model.normals", "net "),
    ],
)
def test_each_mistake_is_one_line(folder: Path, given: list[str], about: str, named: str) -> None:
    answer = call("train.py", *TINY, *given, cwd=folder)
    assert answer.returncode == 2, answer.stderr
    assert refusal(answer.stderr).about == about
    assert named in answer.stderr


def test_an_error_of_the_package_keeps_its_traceback(folder: Path) -> None:
    (folder / "mylab" / "__init__.py").write_text("import col3d\nraise ValueError('mine')\n")
    answer = call("train.py", "plugins=[mylab]", cwd=folder)
    assert answer.returncode == 1
    assert "mylab/__init__.py" in answer.stderr
    assert answer.stderr.splitlines()[-1] == "ValueError: mine"


def test_the_package_to_copy_trains_and_obeys_the_laws(phantom_root: Path, tmp_path: Path) -> None:
    source = PROJECT / "examples" / "mylab"
    given = (*TINY, "plugins=[mylab]", "model=tinynet", "model.width=16", f"data.root={phantom_root}")
    answer = call("train.py", *given, "hydra.run.dir=run", cwd=tmp_path, PYTHONPATH=str(source / "src"))
    assert answer.returncode == 0, answer.stderr
    assert (tmp_path / "run" / "summary.json").is_file()
    laws = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:dash",
            "-p",
            "no:cacheprovider",
            str(source / "tests"),
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(source / "src")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert laws.returncode == 0, laws.stdout

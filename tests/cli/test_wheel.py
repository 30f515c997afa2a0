"""The wheel holds all that the package reads; a stranger's parts train with it where the project is not."""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import textwrap
import time
import venv
import zipfile
from pathlib import Path

import pytest
from refusals import refusal
from tiny_run import TINY

from col3d.io.run_files import read_plain
from col3d.phantom import PhantomSettings, render_phantom

pytestmark = pytest.mark.end_to_end

PROJECT = Path(__file__).parents[2]
IMPORT_ALL = """
import pkgutil, sys, col3d
names = [module.name for module in pkgutil.walk_packages(col3d.__path__, "col3d.")]
for name in names:
    if not name.endswith("__main__"):
        __import__(name)
from col3d.data.datasets.videos import video_table
from col3d.reports.paper_tables import *
print(col3d.__file__, len(names), len(video_table()))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made of a copy, for a build leaves folders beside what it builds."""
    source = tmp_path_factory.mktemp("wheel")
    for path in PROJECT.iterdir():
        if path.is_file() and path.suffix in ("", ".md", ".toml"):
            shutil.copy(path, source)
    shutil.copytree(
        PROJECT / "src", source / "src", ignore=shutil.ignore_patterns("*.egg-info", "__pycache__")
    )
    alone = [] if importlib.util.find_spec("setuptools") is None else ["--no-isolation"]
    command = [sys.executable, "-m", "build", "--wheel", *alone, str(source)]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return next((source / "dist").glob("*.whl"))


def test_it_holds_every_file_of_the_package(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    source = PROJECT / "src"
    files = (path for path in (source / "col3d").rglob("*") if path.is_file())
    wanted = {path.relative_to(source).as_posix() for path in files if path.suffix != ".pyc"}
    assert {
        "col3d/py.typed",
        "col3d/data/datasets/videos.csv",
        "col3d/reports/templates/report.html.j2",
    } <= wanted
    assert not wanted - held
    assert any(name.endswith("dist-info/licenses/LICENSE") for name in held)


@pytest.fixture(scope="module")
def col3d(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command of an environment that has the wheel, and the packages of this one."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", str(wheel)], check=True)
    site = next((home / "lib").glob("python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return home / "bin" / "col3d"


def test_every_module_imports(col3d: Path, tmp_path: Path) -> None:
    python = str(col3d.with_name("python"))
    answer = subprocess.run(
        [python, "-c", IMPORT_ALL], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr
    file, modules, videos = answer.stdout.split()[-3:]
    assert Path(file).is_relative_to(col3d.parents[1])
    assert (int(modules) > 150, int(videos)) == (True, 22)


PARTS = {
    "__init__.py": """
        from mylab import count, far, net, own, slow, worst
    """,
    "net.py": """
        from typing import Annotated
        from col3d.registry import register_model
        from pydantic import Field
        from torch import nn

        @register_model("net", loss="silog", label="My Net", colour="#112233")
        class Net(nn.Module):
            def __init__(self, width: Annotated[int, Field(gt=0)] = 4, dropout: float = 0.0):
                super().__init__()
                first, last = nn.Conv2d(3, width, 3, padding=1), nn.Conv2d(width, 1, 1)
                self.layers = nn.Sequential(first, nn.ReLU(), nn.Dropout2d(dropout), last)

            def forward(self, image, rays=None):
                return {"depth": 100 * self.layers(image).sigmoid(), "seen": image}
    """,
    "far.py": """
        import torch
        from col3d.registry import register_loss

        @register_loss("far")
        def far(prediction, batch, *, power: float = 1.0):
            gap = torch.where(batch["mask"], prediction["depth"] - batch["depth"], 0.0).abs()
            return (gap / 100).pow(power).mean()
    """,
    "worst.py": """
        from col3d.registry import register_metric

        @register_metric("worst", task="depth", better="lower", unit="mm", heading="Worst")
        def worst(preds, target, mask):
            return ((preds - target).abs() * mask).flatten(1).amax(dim=1)
    """,
    "own.py": """
        from col3d.data.datasets.c3vd import C3VD
        from col3d.registry import register_dataset

        @register_dataset("own", normals="stored", label="Own")
        class Own(C3VD):
            def __init__(self, root, videos, normals: str = "stored", height: int = 64, width: int = 80):
                lens = C3VD.lens().resized((height, width))
                super().__init__(root, videos, "current", normals, lens)
    """,
    "slow.py": """
        import torch
        from col3d.registry import register_optimizer

        @register_optimizer("slow", defaults={"lr": 1e-3})
        class Slow(torch.optim.SGD):
            def __init__(self, params, lr: float = 1e-2, momentum: float = 0.5):
                super().__init__(params, lr=lr / 2, momentum=momentum)
    """,
    "count.py": """
        import time
        from col3d.registry import register_callback
        from lightning import Callback

        @register_callback("count")
        class Count(Callback):
            def __init__(self, seconds: float = 0.0):
                self.seconds, self.steps = seconds, 0

            def on_train_batch_end(self, *_):
                self.steps += 1
                time.sleep(self.seconds)

            def on_train_end(self, trainer, module):
                print(f"counted {self.steps}")

            def state_dict(self):
                return {"steps": self.steps}

            def load_state_dict(self, state):
                self.steps = state["steps"]
    """,
}
"""A package as a stranger writes it: one file a part, no configuration."""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """An empty folder, but for that package."""
    (tmp_path / "mylab").mkdir()
    for name, text in PARTS.items():
        (tmp_path / "mylab" / name).write_text(textwrap.dedent(text))
    return tmp_path


def test_the_parts_of_a_stranger_train_beside_ours(col3d: Path, lab: Path) -> None:
    settings = PhantomSettings(
        size_hw=(64, 80), frames_per_video=3, videos=("cecum_t1_a", "desc_t4_a", "trans_t1_a")
    )
    root = lab / "frames"
    render_phantom(root, settings, workers=1, progress=False)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    plugin, data = "plugins=[mylab]", ("data=own", f"data.root={root}")
    tiny = [option for option in TINY if not option.startswith("phantom.")]

    def call(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(col3d), *words],
            cwd=lab,
            env={**environment, **more},
            capture_output=True,
            text=True,
            check=False,
        )

    for words, expected in ((["--help"], "benchmark"), (["list", "models", plugin], "net")):
        answer = call(*words)
        assert answer.returncode == 0, answer.stderr
        assert expected in answer.stdout

    own = (
        "optimizer=slow",
        "callbacks.more.count=count",
        "loss.terms.far.term=far",
        "loss.lambdas=[1.0,0.5]",
    )
    both = ("-m", *tiny, *data, plugin, "model=net,bts", "loss=silog", *own)
    sweep = call("train", *both, "hydra.sweep.dir=both")
    assert sweep.returncode == 0, sweep.stderr
    assert sweep.stdout.count("minimises 1 silog + 0.5 far") == 2
    runs = sorted(path.parent for path in (lab / "both").glob("*/result.json"))
    assert len(runs) == 2

    one = (
        *tiny,
        *data,
        plugin,
        "model=net",
        "model.width=6",
        "model.dropout=0.1",
        *own,
        "trainer.max_epochs=4",
    )
    cut = [str(col3d), "train", *one, "callbacks.more.count.seconds=0.5", "hydra.run.dir=both/cut"]
    process = subprocess.Popen(cut, cwd=lab, env=environment, stdout=subprocess.DEVNULL)
    while read_plain(lab / "both" / "cut" / "status.json").get("epoch", 0) < 1:
        assert process.poll() is None
        time.sleep(0.1)
    process.kill()
    process.wait()
    again = call(*cut[1:])
    assert again.returncode == 0, again.stderr
    assert "goes on from" in again.stdout
    assert "counted 12" in again.stdout  # 3 steps in each of 4 epochs, those before the kill among them

    best = "checkpoint=both/cut/checkpoints/best.ckpt"
    without = call("evaluate", best)
    assert (without.returncode, without.stdout) == (2, "")
    assert "plugins=[mylab]" in refusal(without.stderr).message
    scored = call("evaluate", best, "output_dir=scored", "workers=0", COL3D_PLUGINS="mylab")
    assert scored.returncode == 0, scored.stderr
    for table in ("scored/per_frame.csv", "both/cut/per_frame.csv"):
        header, first = (lab / table).read_text().splitlines()[:2]
        assert float(dict(zip(header.split(","), first.split(","), strict=True))["worst"]) > 0
    assert "val/worst" in (lab / "both" / "cut" / "metrics.csv").read_text().splitlines()[0]
    image = next((root / "desc_t4_a").glob("*_color.png"))
    predicted = call("predict", best, plugin, f"input={image}", "output=predicted", "camera=c3vd")
    assert predicted.returncode == 0, predicted.stderr
    reported = call("report", "both", "report")
    assert reported.returncode == 0, reported.stderr
    page = (lab / "report" / "report.html").read_text()
    assert "My Net" in page
    assert "Worst" in page

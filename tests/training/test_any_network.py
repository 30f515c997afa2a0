"""Networks of any make: without options, without parameters, with more to say than depth."""

from pathlib import Path

import pytest
from programs import call
from refusals import refusal
from tiny_run import TINY

pytestmark = pytest.mark.end_to_end

PACKAGE = '''
"""Networks of a laboratory."""

import torch
from torch import nn

from col3d.registry import register_loss, register_model


@register_model("plain")
class Plain(nn.Module):
    """No option at all."""

    def __init__(self):
        super().__init__()
        self.conv = nn.Conv2d(3, 1, 3, padding=1)

    def forward(self, image, rays=None):
        return {"depth": 100.0 * self.conv(image).sigmoid()}


@register_model("talkative")
class Talkative(Plain):
    """Returns more than maps."""

    def forward(self, image, rays=None):
        features = self.conv(image)
        more = {"features": [features], "note": "hello", "nothing": None, "scale": features.mean()}
        return {"depth": 100.0 * features.sigmoid(), **more, "broken": features.new_full((1,), torch.nan)}


@register_model("fixed")
class Fixed(nn.Module):
    """Buffers and nothing that learns."""

    def __init__(self):
        super().__init__()
        self.register_buffer("level", torch.full((1, 1, 1, 1), 50.0))

    def forward(self, image, rays=None):
        return {"depth": self.level.expand(len(image), 1, *image.shape[-2:])}


@register_model("mixed")
class Mixed(Plain):
    """Buffers beside what learns."""

    def __init__(self):
        super().__init__()
        self.register_buffer("level", torch.full((1, 1, 1, 1), 50.0))

    def forward(self, image, rays=None):
        return {"depth": self.level * (0.5 + self.conv(image).sigmoid())}


@register_loss("small_scale")
def small_scale(prediction, batch):
    """Uses what the network says beside depth."""
    return prediction["scale"] ** 2
'''


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "anynets").mkdir()
    (tmp_path / "anynets" / "__init__.py").write_text(PACKAGE)
    return tmp_path


@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("plain", []),
        ("mixed", ["callbacks.more.ema=EMAWeightAveraging"]),
        (
            "talkative",
            ["callbacks.predictions=true", "loss.terms.small=small_scale", "loss.lambdas=[1.0,0.1]"],
        ),
    ],
)
def test_any_network_trains_and_is_evaluated(
    model: str, more: list[str], folder: Path, phantom_root: Path
) -> None:
    run = folder / "run"
    given = ("plugins=[anynets]", f"model={model}", f"data.root={phantom_root}", *more)
    trained = call("train.py", *TINY, *given, f"hydra.run.dir={run}", cwd=folder)
    assert trained.returncode == 0, trained.stderr
    best = f"checkpoint={run / 'checkpoints' / 'best.ckpt'}"
    scored = call("evaluate", best, f"output_dir={folder / 'scored'}", cwd=folder, COL3D_PLUGINS="anynets")
    assert scored.returncode == 0, scored.stderr
    assert (folder / "scored" / "per_frame.csv").is_file()


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        (["model=fixed"], "model", "Fixed has no parameters"),
        (["model=plain", "model.widht=3"], "model.widht", "no such option"),
        (["model=plain", "optimizer.layer_decay=0.9"], "optimizer.layer_decay", "Plain has no module"),
        (
            ["model=plain", "optimizer.encoder_lr=1e-5"],
            "optimizer.encoder_lr",
            "Plain has no module `encoder`",
        ),
        (["model=plain", "model.freeze=[encoder]"], "model.freeze", "Plain has no module `encoder`"),
    ],
)
def test_what_a_network_cannot_do_is_one_line(
    given: list[str], about: str, named: str, folder: Path, phantom_root: Path
) -> None:
    place = (f"data.root={phantom_root}", f"hydra.run.dir={folder / 'run'}")
    answer = call("train.py", *TINY, "plugins=[anynets]", *given, *place, cwd=folder)
    assert answer.returncode == 2, answer.stderr
    assert refusal(answer.stderr).about == about
    assert named in answer.stderr
    assert not (folder / "run").exists()

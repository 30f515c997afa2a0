"""The same function as timm's where that fills nothing up; its files and Microsoft's; refusals."""

import re
from pathlib import Path

import pytest
import timm
import torch
from refusals import refused
from torch import Tensor, nn

from col3d.errors import OptionError
from col3d.layers.swin import SIZES, Swin

TINY = "swin_tiny_patch4_window7_224"


@pytest.fixture(scope="module")
def classifier() -> nn.Module:
    """timm's for an image whose maps have 112, 56, 28 and 14 pixels a side."""
    torch.manual_seed(0)
    net = timm.create_model(TINY, img_size=448).eval()
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
    return net


def microsoft(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The names of Microsoft's releases, with what else their files hold."""
    renamed = {
        re.sub(r"^layers\.(\d)\.downsample", lambda m: f"layers.{int(m[1]) - 1}.downsample", name): value
        for name, value in weights.items()
    }
    index = {"layers.0.blocks.0.attn.relative_position_index": torch.zeros(49, 49, dtype=torch.int64)}
    return renamed | index | {"layers.0.blocks.1.attn_mask": torch.zeros(64, 49, 49)}


@pytest.fixture(params=["timm", "microsoft"])
def file(request: pytest.FixtureRequest, classifier: nn.Module, tmp_path: Path) -> Path:
    weights = classifier.state_dict()
    torch.save(weights if request.param == "timm" else {"model": microsoft(weights)}, tmp_path / "swin.pth")
    return tmp_path / "swin.pth"


def test_equals_timm_with_the_weights_of_a_file(classifier: nn.Module, file: Path) -> None:
    swin, image = Swin(TINY, str(file)).eval(), torch.randn(1, 3, 448, 448)
    with torch.no_grad():
        theirs = classifier.forward_intermediates(image, intermediates_only=True)
        for ours, expected in zip(swin(image), theirs, strict=True):
            normalised = nn.functional.layer_norm(expected.permute(0, 2, 3, 1), expected.shape[1:2])
            torch.testing.assert_close(ours, normalised.permute(0, 3, 1, 2), atol=1e-4, rtol=0)


@pytest.mark.parametrize("name", list(SIZES))
def test_four_scales(name: str) -> None:
    with torch.device("meta"):
        swin = Swin(name)
        maps = swin(torch.rand(2, 3, 64, 96))
    assert [tuple(m.shape) for m in maps] == [
        (2, c, 64 // s, 96 // s) for c, s in zip(swin.channels, (4, 8, 16, 32), strict=True)
    ]


def test_fewer_residuals_the_deeper() -> None:
    with torch.device("meta"):
        blocks = [block for stage in Swin(TINY, drop_path=0.22).layers for block in stage.blocks]
    assert [block.drop_path.drop_prob for block in blocks] == pytest.approx([0.02 * i for i in range(12)])


@pytest.mark.parametrize(
    ("name", "tagged"), [(TINY, f"{TINY}.ms_in22k"), (f"{TINY}.ms_in1k", f"{TINY}.ms_in1k")]
)
def test_fetches_the_largest_training_or_that_of_the_tag(
    name: str, tagged: str, classifier: nn.Module, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(
        timm, "create_model", lambda name, **options: asked.append((name, options)) or classifier
    )
    swin = Swin(name, "imagenet")
    assert asked == [(tagged, {"pretrained": True})]
    assert torch.equal(swin.patch_embed.proj.weight, classifier.patch_embed.proj.weight)


def test_no_network_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("offline")

    monkeypatch.setattr(timm, "create_model", refuse)
    with refused(OptionError, "model.pretrained", "_224.ms_in22k'", "OSError", "pretrained=none"):
        Swin(TINY, "imagenet")


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("resnet50", ("newcrfs", "swin_tiny", "swin_large", "'resnet50'")),
        ("swin_tiny_patch4_window7_225", ("'swin_tiny_patch4_window7_225'", f"'{TINY}'")),
        (f"{TINY}.ms_in22", ("timm", f"'{TINY}.ms_in22'", f"'{TINY}.ms_in22k'")),
    ],
)
def test_refuses_other_encoders(name: str, named: tuple[str, ...]) -> None:
    with refused(OptionError, "model.encoder", *named):
        Swin(name)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (None, ("no file", "swin.pth'")),
        ("not weights", ("swin.pth'", "read as weights")),
        ({"head.weight": torch.zeros(3)}, ("169 weights", "'patch_embed.proj.weight'")),
    ],
)
def test_refuses_files(content: object, named: tuple[str, ...], tmp_path: Path) -> None:
    if isinstance(content, str):
        (tmp_path / "swin.pth").write_text(content)
    elif content is not None:
        torch.save(content, tmp_path / "swin.pth")
    with refused(OptionError, "model.pretrained", *named):
        Swin(TINY, str(tmp_path / "swin.pth"))


def test_refuses_the_file_of_another_size(classifier: nn.Module, tmp_path: Path) -> None:
    name = "layers.0.blocks.0.attn.relative_position_bias_table"
    torch.save(classifier.state_dict() | {name: torch.zeros(23 * 23, 3)}, tmp_path / "window12.pth")
    with refused(OptionError, None, "1 weights", repr(name)):
        Swin(TINY, str(tmp_path / "window12.pth"))

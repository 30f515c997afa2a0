"""Five scales or a clear refusal; weights from files."""

from pathlib import Path

import pytest
import timm
import torch
from refusals import refused

from col3d.errors import OptionError
from col3d.layers.encoder import Encoder


@pytest.mark.parametrize(
    ("name", "channels"),
    [("resnet18", [64, 64, 128, 256, 512]), ("mobilenetv3_small_050", [16, 8, 16, 24, 288])],
)
def test_five_scales(name: str, channels: list[int]) -> None:
    encoder = Encoder(name).eval()
    maps = encoder(torch.rand(1, 3, 64, 96))
    assert [tuple(m.shape[1:]) for m in maps] == [
        (c, 64 // s, 96 // s) for c, s in zip(channels, (2, 4, 8, 16, 32), strict=True)
    ]
    assert encoder.channels == channels


def test_first_map_of_a_resnet_is_its_first_relu() -> None:
    encoder, x = Encoder("resnet18").eval(), torch.randn(1, 3, 64, 64)
    assert torch.equal(encoder(x)[0], torch.relu(encoder.net.bn1(encoder.net.conv1(x))))


@pytest.mark.parametrize("name", ["vit_tiny_patch16_224", "convnext_atto"])
def test_refuses_an_encoder_without_five_scales(name: str) -> None:
    with refused(OptionError, "model.encoder", repr(name), "/2", "but it has /"):
        Encoder(name)


def test_unknown_tag_passes_on_what_timm_says() -> None:
    with refused(OptionError, "model.encoder", "'resnet18.absent'"):
        Encoder("resnet18.absent")


def test_unknown_encoder_names_the_nearest() -> None:
    with refused(OptionError, "model.encoder", "'resnet181'", "'resnet18"):
        Encoder("resnet181")


def test_no_network_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("offline")

    monkeypatch.setattr(timm, "create_model", refuse)
    with refused(OptionError, "model.pretrained", "'resnet18'", "OSError", "model.pretrained=none"):
        Encoder("resnet18", "imagenet")


def test_missing_file(tmp_path: Path) -> None:
    with refused(OptionError, "model.pretrained", f"no file '{tmp_path / 'absent.pt'}'"):
        Encoder("resnet18", str(tmp_path / "absent.pt"))


def test_file_that_is_not_weights(tmp_path: Path) -> None:
    (tmp_path / "text.pt").write_text("not weights")
    with refused(OptionError, "model.pretrained", tmp_path / "text.pt", "read as weights"):
        Encoder("resnet18", str(tmp_path / "text.pt"))


def test_file_of_another_encoder(tmp_path: Path) -> None:
    torch.save({"conv1.weight": torch.zeros(64, 3, 7, 7)}, tmp_path / "other.pt")
    with refused(OptionError, "model.pretrained", "lacks ", "'bn1.weight'"):
        Encoder("resnet18", str(tmp_path / "other.pt"))


def test_file_of_a_wider_encoder(tmp_path: Path) -> None:
    torch.save(timm.create_model("resnet50").state_dict(), tmp_path / "resnet50.pt")
    with refused(OptionError, "model.pretrained", "fit", "'layer1.0.conv1.weight'"):
        Encoder("resnet18", str(tmp_path / "resnet50.pt"))


@pytest.mark.parametrize("name", ["resnet18", "densenet121"])
def test_file_of_a_classifier_fills_the_encoder(name: str, tmp_path: Path) -> None:
    classifier, path = timm.create_model(name), tmp_path / "classifier.pt"
    torch.save({"state_dict": classifier.state_dict()}, path)
    stored = {key.replace(".", "_"): value for key, value in classifier.state_dict().items()}
    for key, value in Encoder(name, str(path)).net.state_dict().items():
        assert torch.equal(value, stored[key.replace(".", "_")]), key


def test_file_of_a_deeper_encoder(tmp_path: Path) -> None:
    torch.save(timm.create_model("resnet34").state_dict(), tmp_path / "deeper.pt")
    with refused(OptionError, "model.pretrained", "larger", "'layer1.2.conv1"):
        Encoder("resnet18", str(tmp_path / "deeper.pt"))


@pytest.mark.parametrize("name", ["maxvit_pico_rw_256", "inception_v3"])
def test_refuses_an_encoder_that_takes_other_sizes(name: str) -> None:
    with refused(ValueError, "model.encoder", repr(name), "64 x 96"):
        Encoder(name)

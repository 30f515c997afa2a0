"""Laws that every network obeys: sizes, units, gradients, precision, and how networks are made and saved."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.models import NETWORKS, create

DISTINCT = ["bts", "bts_cbam", "col3d_mtl"]


@pytest.fixture(scope="module", params=DISTINCT)
def network(request: pytest.FixtureRequest) -> nn.Module:
    torch.manual_seed(0)
    return create(request.param, encoder="resnet18", width=64)


def predict(network: nn.Module, image: Tensor) -> Prediction:
    with torch.no_grad():
        prediction: Prediction = network.eval()(image)
    return prediction


def gradients(network: nn.Module, image: Tensor) -> dict[str, Tensor | None]:
    network.train().zero_grad()
    prediction = network(image)
    sum((output * torch.randn_like(output)).sum() for output in prediction.values()).backward()
    return {name: parameter.grad for name, parameter in network.named_parameters()}


@pytest.mark.parametrize("size_hw", [(65, 97), (64, 96), (33, 32), (20, 40)])
def test_any_size(network: nn.Module, size_hw: tuple[int, int]) -> None:
    prediction = predict(network, torch.rand(2, 3, *size_hw))
    assert set(prediction) == set(network.tasks)
    assert prediction["depth"].shape == (2, 1, *size_hw)
    assert 0 < prediction["depth"].min() <= prediction["depth"].max() < 100
    if "normals" in network.tasks:
        assert prediction["normals"].shape == (2, 3, *size_hw)


def test_padding_repeats_the_border(network: nn.Module) -> None:
    image = torch.rand(1, 3, 60, 90)
    padded = nn.functional.pad(image, (0, 6, 0, 4), mode="replicate")
    for task, whole in predict(network, padded).items():
        torch.testing.assert_close(predict(network, image)[task], whole[..., :60, :90], atol=1e-4, rtol=0)


def test_batched_equals_single(network: nn.Module) -> None:
    images = torch.rand(3, 3, 64, 64)
    for task, batched in predict(network, images).items():
        single = torch.cat([predict(network, image[None])[task] for image in images])
        torch.testing.assert_close(batched, single, atol=1e-3, rtol=1e-4)


def test_forward_normalises_with_imagenet(network: nn.Module) -> None:
    image = torch.rand(1, 3, 64, 64)
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    with torch.no_grad():
        normalised = network.eval().forward_normalised((image - mean[:, None, None]) / std[:, None, None])
    for task, value in predict(network, image).items():
        torch.testing.assert_close(value, normalised[task])


def test_every_parameter_learns_and_no_gradient_explodes(network: nn.Module) -> None:
    image = torch.rand(2, 3, 64, 64, requires_grad=True)
    for name, weight in network.encoder.named_parameters():
        if "bn2.weight" in name:  # timm starts these at zero, which hides the convolutions before them
            nn.init.ones_(weight)
    found = gradients(network, image)
    dead = [name for name, gradient in found.items() if gradient is None or not gradient.any()]
    assert not dead
    assert all(
        gradient.isfinite().all() for gradient in [*found.values(), image.grad] if gradient is not None
    )
    assert image.grad is not None
    assert image.grad.any()


def test_depth_scales_with_its_maximum() -> None:
    networks = []
    for max_depth in (100.0, 10.0):
        torch.manual_seed(0)
        networks.append(create("bts", encoder="resnet18", width=64, max_depth=max_depth))
    image = torch.rand(1, 3, 64, 64)
    torch.testing.assert_close(
        *(predict(n, image)["depth"] / m for n, m in zip(networks, (100, 10), strict=True))
    )


def test_bfloat16_is_close(network: nn.Module) -> None:
    image = torch.rand(2, 3, 64, 64)
    exact = predict(network, image)
    with torch.autocast("cpu", torch.bfloat16):
        rough = predict(network, image)
    assert all(value.dtype == torch.float32 and value.isfinite().all() for value in rough.values())
    assert (rough["depth"] - exact["depth"]).abs().mean() < 2
    if "normals" in network.tasks:
        assert (rough["normals"] - exact["normals"]).abs().mean() < 0.02


def test_bfloat16_gradients_are_finite(network: nn.Module) -> None:
    with torch.autocast("cpu", torch.bfloat16):
        found = gradients(network, torch.rand(2, 3, 64, 64))
    assert all(gradient is not None and gradient.isfinite().all() for gradient in found.values())


def test_weights_survive_a_file(network: nn.Module, tmp_path: Path) -> None:
    torch.save(network.state_dict(), tmp_path / "weights.pt")
    names = {"BTS": "bts", "BTSCBAM": "bts_cbam", "Col3DMTL": "col3d_mtl"}
    other = create(names[type(network).__name__], encoder="resnet18", width=64)
    other.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    image = torch.rand(1, 3, 64, 64)
    assert all(
        torch.equal(value, predict(other, image)[task]) for task, value in predict(network, image).items()
    )


def test_normalisation_is_no_weight(network: nn.Module) -> None:
    assert not {"mean", "std"} & set(network.state_dict())


@pytest.mark.parametrize("name", list(NETWORKS))
def test_every_name_makes_its_network(name: str) -> None:
    network = create(name, encoder="resnet18", width=128)
    assert type(network) is NETWORKS[name]
    assert network.tasks == (("depth", "normals") if name.endswith("mtl") else ("depth",))


def test_unknown_name() -> None:
    with pytest.raises(ValueError, match=r"model\.name: 'bts_cban' is unknown; did you mean 'bts_cbam'"):
        create("bts_cban")


def test_import_leaves_timm_alone() -> None:
    code = "import sys, col3d.models.published; sys.exit('timm' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

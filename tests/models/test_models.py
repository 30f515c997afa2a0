"""Laws that every network obeys: sizes, units, gradients, precision, and how networks are made and saved."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from refusals import refused
from small import small
from timm.layers import DropPath
from torch import Tensor, nn

from col3d.batch import Prediction
from col3d.errors import OptionError
from col3d.geometry import OmnidirectionalCamera
from col3d.layers.network import DepthNetwork
from col3d.models import create
from col3d.registry import MODELS, available

DEPTH_ALONE = ("bts", "bts_cbam", "newcrfs", "monodepth_fpn", "pix2pix")
DISTINCT = [
    *((name, "none", "camera") for name in DEPTH_ALONE),
    ("col3d_mtl", "unc", "camera"),
    *((name, "unc", "ray") for name in (*DEPTH_ALONE, "col3d_mtl")),
]
LENS = OmnidirectionalCamera.c3vd()


@pytest.fixture(scope="module", params=DISTINCT, ids="-".join)
def network(request: pytest.FixtureRequest) -> DepthNetwork:
    torch.manual_seed(0)
    name, normals, frame = request.param
    return small(name, normals=normals, normal_frame=frame)


def run(network: nn.Module, image: Tensor) -> Prediction:
    """On the rays of the lens at the image's size, one map for all frames."""
    prediction: Prediction = network(image, LENS.resized((image.shape[2], image.shape[3])).rays())
    return prediction


def predict(network: nn.Module, image: Tensor) -> Prediction:
    with torch.no_grad():
        return run(network.eval(), image)


def gradients(network: nn.Module, image: Tensor) -> dict[str, Tensor | None]:
    """In training mode, but for what is left out at random."""
    network.train().zero_grad()
    for block in network.modules():
        if isinstance(block, nn.Dropout | DropPath):
            block.eval()
    prediction = run(network, image)
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
    rays = LENS.resized((60, 90)).rays()[None]
    padded, padded_rays = (nn.functional.pad(x, (0, 6, 0, 4), mode="replicate") for x in (image, rays))
    with torch.no_grad():
        whole, part = network.eval()(padded, padded_rays), network(image, rays)
    for task, value in part.items():
        torch.testing.assert_close(value, whole[task][..., :60, :90], atol=1e-4, rtol=0)


def test_batched_equals_single(network: nn.Module) -> None:
    images = torch.rand(3, 3, 64, 64)
    for task, batched in predict(network, images).items():
        single = torch.cat([predict(network, image[None])[task] for image in images])
        torch.testing.assert_close(batched, single, atol=1e-3, rtol=1e-4)


def test_forward_normalises_with_imagenet(network: nn.Module) -> None:
    image = torch.rand(1, 3, 64, 64)
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    with torch.no_grad():
        normalised = network.eval().forward_normalised(
            (image - mean[:, None, None]) / std[:, None, None], LENS.resized((64, 64)).rays()
        )
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
    name = next(name for name in reversed(available("model")) if MODELS[name].build is type(network))
    normals = "unc" if "normals" in network.tasks else "none"
    other = small(name, normals=normals, normal_frame="ray" if network.needs_rays else "camera")
    other.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    image = torch.rand(1, 3, 64, 64)
    assert all(
        torch.equal(value, predict(other, image)[task]) for task, value in predict(network, image).items()
    )


def test_normalisation_is_no_weight(network: nn.Module) -> None:
    assert not {"mean", "std"} & set(network.state_dict())


@pytest.mark.parametrize("name", available("model"))
def test_every_name_makes_its_network(name: str) -> None:
    network = small(name)
    assert type(network) is MODELS[name].build
    assert network.tasks == MODELS[name].facts["predicts"]


def test_normals_in_the_frame_of_the_ray_face_the_camera(network: DepthNetwork) -> None:
    if network.needs_rays:
        normals = predict(network, torch.rand(1, 3, 64, 96))["normals"]
        assert ((normals * LENS.resized((64, 96)).rays()).sum(dim=1) < 0).all()
        with refused(ValueError, "rays"):
            network(torch.rand(1, 3, 64, 96))


def test_attention_and_normals_are_all_that_col3d_mtl_adds() -> None:
    networks = (small("bts_cbam", normals="unc"), small("col3d_mtl"))
    networks[1].load_state_dict(networks[0].state_dict())
    image = torch.rand(1, 3, 64, 64)
    found, expected = (predict(network, image) for network in networks)
    assert all(torch.equal(found[task], expected[task]) for task in ("depth", "normals"))


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        ({"name": "col3d_mtl", "normals": "none"}, "model.normals", ("col3d_mtl",)),
        ({"name": "bts", "normals": "ucn"}, "model.normals", ("'ucn'", "'unc'")),
        ({"name": "bts", "normals": "unc", "normal_frame": "rays"}, "model.normal_frame", ("'rays'",)),
        ({"name": "bts", "max_depth": 0.0}, "model.max_depth", ("greater than 0",)),
    ],
)
def test_what_does_not_fit(options: dict[str, str], about: str, named: tuple[str, ...]) -> None:
    with refused(OptionError, about, *named):
        small(**options)


def test_unknown_name() -> None:
    with refused(OptionError, "model.name", "'bts_cban'", "'bts_cbam'"):
        create("bts_cban")


def test_import_leaves_timm_alone() -> None:
    code = "import sys, col3d.models.published; sys.exit('timm' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

"""Col3D-MTL's normals: unit, in standard axes, anywhere on the sphere."""

import pytest
import torch
from torch import Tensor

from col3d.layers.normal_decoder import enlarge
from col3d.models.col3d_mtl import Col3DMTL, published_normals, standard_from_published


@pytest.fixture(scope="module", params=["standard", "published"])
def network(request: pytest.FixtureRequest) -> Col3DMTL:
    torch.manual_seed(0)
    return Col3DMTL("resnet18", width=64, heads=request.param).eval()


def normals_of(network: Col3DMTL, image: Tensor) -> Tensor:
    with torch.no_grad():
        normals: Tensor = network(image)["normals"]
    return normals


def test_unit_length(network: Col3DMTL) -> None:
    lengths = normals_of(network, torch.rand(2, 3, 65, 97)).norm(dim=1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_faces_the_camera_before_training() -> None:
    towards = -normals_of(Col3DMTL("resnet18", width=128), torch.rand(2, 3, 64, 64))[:, 2]
    assert towards.clamp(max=1).acos().rad2deg().mean() < 20


def test_heads_reach_the_whole_sphere() -> None:
    network = Col3DMTL("resnet18", width=64)
    for axis, head in network.normal_decoder.head.items():
        torch.nn.init.constant_(head.weight, 0)
        torch.nn.init.constant_(head.bias, {"x": 0.6, "y": 0.0, "z": 0.8}[axis])
    normals = normals_of(network, torch.rand(1, 3, 64, 64))
    torch.testing.assert_close(normals[0, :, 5, 5], torch.tensor([0.6, 0.0, 0.8]))


def test_published_normals_turn_to_standard_axes() -> None:
    raw = torch.tensor([1.0, 2.0, 3.0]).view(1, 3, 1, 1)
    x, y, z = published_normals(raw).flatten().tolist()
    assert (x, y, z) == pytest.approx((0.76159, 0.96403, 0.95257), abs=1e-5)
    length = (x * x + y * y + z * z) ** 0.5
    assert standard_from_published(raw).flatten().tolist() == pytest.approx(
        (x / length, -y / length, -z / length)
    )


def test_published_heads_always_face_the_camera() -> None:
    assert (standard_from_published(torch.randn(1, 3, 20, 20))[:, 2] < 0).all()


def test_tasks_share_only_encoder_and_trunk(network: Col3DMTL) -> None:
    prediction = network(torch.rand(1, 3, 64, 64))
    inner = {name.split(".")[0] for name, _ in network.named_parameters()}
    assert inner == {"encoder", "trunk", "depth_decoder", "normal_decoder"}
    decoder = list(network.depth_decoder.parameters())
    found = torch.autograd.grad(prediction["normals"].sum(), decoder, allow_unused=True)
    assert all(gradient is None for gradient in found)


def test_enlarge_repeats() -> None:
    x = torch.rand(1, 2, 3, 4)
    assert torch.equal(enlarge(x, 8), x.repeat_interleave(8, 2).repeat_interleave(8, 3))

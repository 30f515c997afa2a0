"""Published weights: the authors' numbers, and what the importer refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from parity import needs_parity, network_input, published_numbers, published_state
from refusals import refused
from torch import Tensor

from col3d.errors import OptionError
from col3d.geometry import PinholeCamera, normals_from_depth
from col3d.layers.normal_decoder import enlarge
from col3d.models import create
from col3d.models.col3d_mtl import published_normals
from col3d.models.published import SOURCES, load_published, read_weights, tensors_of
from col3d.models.published.source import our_name

FAMILY = ["bts", "col3d_bts_cbam", "col3d_mtl_no_xtc", "col3d_mtl"]


def assert_close(found: Tensor, expected: Tensor, atol: float) -> None:
    torch.testing.assert_close(found, expected, atol=atol, rtol=0)


@needs_parity
@pytest.mark.parametrize("source", FAMILY)
def test_authors_numbers(source: str) -> None:
    network, expected = load_published(source, published_state(source)), published_numbers(source)
    maps: dict[str, Tensor] = {}
    for name, block in network.named_modules():
        block.register_forward_hook(lambda _, __, out, name=name: maps.update({name: out}))
    with torch.no_grad():
        prediction = network.forward_normalised(network_input())
    assert_close(prediction["depth"], expected["depth"], atol=1e-3)
    for k in (8, 4, 2):
        assert_close(maps[f"depth_decoder.plane{k}"], expected[f"lpg{k}x{k}"], atol=1e-4)
    if "normals" in network.tasks:
        for k in (8, 4, 2):
            assert_close(enlarge(maps[f"normal_decoder.normal{k}"], k), expected[f"normal{k}x{k}"], atol=1e-4)
        raw = torch.cat([maps[f"normal_decoder.head.{axis}"] for axis in "xyz"], dim=1)
        assert_close(published_normals(raw), expected["normal"], atol=1e-4)
        standard = expected["normal"] * torch.tensor([1.0, -1.0, -1.0])[:, None, None]
        assert_close(prediction["normals"], standard / standard.norm(dim=1, keepdim=True), atol=1e-4)


@needs_parity
@pytest.mark.parametrize("source", FAMILY)
def test_bfloat16_costs_less_than_a_percent(source: str) -> None:
    """Of depth, on average over the pixels, against the authors' own numbers."""
    network, expected = load_published(source, published_state(source)), published_numbers(source)["depth"]
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        depth = network.forward_normalised(network_input())["depth"]
    assert depth.dtype == torch.float32
    assert ((depth - expected).abs() / expected).mean() < 0.01


@needs_parity
def test_authors_numbers_of_newcrfs() -> None:
    network = load_published("newcrfs", published_state("newcrfs"))
    with torch.no_grad():
        depth = network.forward_normalised(network_input())["depth"]
    assert_close(depth, published_numbers("newcrfs")["depth"], atol=1e-3)


@needs_parity
def test_authors_numbers_of_monodepth_fpn() -> None:
    network = load_published("monodepth_fpn", published_state("monodepth_fpn"))
    found: list[Tensor] = []
    network.get_submodule("depth_decoder").register_forward_hook(lambda _, __, out: found.append(out))
    with torch.no_grad():
        network.forward_normalised(network_input())
        plain, fed = network(network_input().sigmoid()), network.forward_normalised(network_input().sigmoid())
    assert torch.equal(plain["depth"], fed["depth"])  # that program does not normalise its images
    expected = published_numbers("monodepth_fpn")["depth_quarter"]
    assert expected.std() > 0.1  # the reference is no saturated map, which anything would match
    assert_close(found[0], expected, atol=1e-4)


@needs_parity
def test_the_depth_to_normal_module_in_its_pinhole() -> None:
    """All but the last row and column, where the authors' module leaves zeros.

    In one of its six derivatives theirs divides by fx where fy belongs, which is 1.0001 times as large: up to
    3e-4 at the steepest pixels. With that slip put in, the formula is theirs to rounding.
    """
    expected, depth = published_numbers("col3d_mtl")["warped_normal"], published_numbers("col3d_mtl")["depth"]
    camera = PinholeCamera.c3vd_published((160, 192))
    standard = normals_from_depth(depth.double(), camera.rays().double(), differences="forward")
    published = (standard * torch.tensor([1.0, -1.0, -1.0])[:, None, None])[..., :-1, :-1].float()
    assert_close(published, expected[..., :-1, :-1], atol=3.2e-4)
    assert (published - expected[..., :-1, :-1]).abs().quantile(0.95) < 1e-4
    assert_close(slipped_normals(depth.double()).float(), expected[..., :-1, :-1], atol=1e-6)
    assert_close(slipped_normals(depth.double(), right=True).float(), published, atol=2e-5)  # float32 rays
    assert not standard[..., -1, :].any()
    assert not standard[..., -1].any()


def slipped_normals(depth: Tensor, right: bool = False) -> Tensor:
    """A twin of the authors' module, written out for the pinhole at 160 x 192, in their axes."""
    fx, cx = 769.807403688120 * 192 / 1350, 675.226397736271 * 192 / 1350
    fy, cy = 769.720558534159 * 160 / 1080, 548.903474592445 * 160 / 1080
    x, y = torch.arange(191).double()[None], torch.arange(159).double()[:, None]
    z, z_x, z_y = depth[0, 0, :-1, :-1], depth[0, 0].diff(dim=1)[:-1], depth[0, 0].diff(dim=0)[:, :-1]
    along_x = torch.stack([z / fx + (x - cx) / fx * z_x, (y - cy) / fy * z_x, z_x])
    slip = fy if right else 769.807403688120 * 160 / 1080
    along_y = torch.stack([(x - cx) / fx * z_y, z / fy + (y - cy) / slip * z_y, z_y])
    normal = torch.linalg.cross(along_x, along_y, dim=0)
    return (normal / normal.norm(dim=0) * torch.tensor([-1.0, 1.0, 1.0])[:, None, None])[None]


@needs_parity
@pytest.mark.parametrize(
    ("source", "dead"),
    [
        ("bts", ["encoder.base_model.fc.weight", "encoder.base_model.fc.bias"]),
        ("col3d_bts_cbam", ["depth_decoder.conv1_concat.0.weight", "normal_decoder.conv1_x.0.weight"]),
        ("col3d_mtl", ["depth_decoder.conv1_x_d2n.0.weight", "normal_decoder.get_n2d.0.weight"]),
    ],
)
def test_names_what_it_skips(source: str, dead: list[str]) -> None:
    assert set(dead) <= set(load_published(source, published_state(source)).skipped_names)


@needs_parity
@pytest.mark.parametrize("wrapper", ["model", "state_dict"])
def test_wrappers_and_prefixes_change_nothing(wrapper: str) -> None:
    state = published_state("bts")
    wrapped = {"global_step": 7, wrapper: {f"module.{name}": value for name, value in state.items()}}
    plain, unwrapped = load_published("bts", state).state_dict(), load_published("bts", wrapped).state_dict()
    assert all(torch.equal(value, unwrapped[name]) for name, value in plain.items())


@needs_parity
def test_integer_tensors_may_be_there() -> None:
    name = "encoder.base_model.bn1.num_batches_tracked"
    network = load_published("bts", published_state("bts") | {name: torch.tensor(7)})
    assert network.state_dict()["encoder.net.bn1.num_batches_tracked"] == 7


@needs_parity
@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"decoder.extra.weight": torch.zeros(1)}, ("unknown decoder.extra.weight",)),
        (
            {"decoder.get_depth.0.weight": torch.zeros(1)},
            ("decoder.get_depth.0.weight", "(1,) for (1, 32, 3, 3)"),
        ),
        ({"decoder.get_depth.0.weight": None}, ("lacks depth_decoder.head.weight",)),
    ],
)
def test_refuses_what_does_not_fit(change: dict[str, Tensor | None], named: tuple[str, ...]) -> None:
    state = {name: value for name, value in (published_state("bts") | change).items() if value is not None}
    with refused(ValueError, "state_dict", *named):
        load_published("bts", state)


def test_refuses_weights_of_nobody() -> None:
    with refused(ValueError, "state_dict", "bts", "fc.weight"):
        load_published("bts", {"fc.weight": torch.zeros(1)})


@needs_parity
def test_base_weights_fit_without_the_convolutions_they_lack() -> None:
    network = load_published("newcrfs", published_state("newcrfs_base"))
    assert network.get_submodule("encoder").channels == [128, 256, 512, 1024]


@needs_parity
def test_integer_buffers_are_neither_needed_nor_refused() -> None:
    name = "backbone.layers.0.blocks.0.attn.relative_position_index"
    state = published_state("newcrfs") | {name: torch.zeros(49, 49, dtype=torch.int64)}
    assert name in load_published("newcrfs", state).skipped_names


@pytest.mark.parametrize(
    ("source", "model", "encoder"),
    [
        ("col3d_mtl", "col3d_mtl", "resnet18"),
        ("bts", "bts", "resnet18"),
        ("newcrfs", "newcrfs", "swin_tiny_patch4_window7_224"),
    ],
)
def test_our_own_checkpoints_serve(source: str, model: str, encoder: str) -> None:
    options = {"name": model, "encoder": encoder, "width": 64, "max_depth": 80.0, "freeze": []}
    network = create(model, encoder=encoder, width=64, max_depth=80.0, normals="unc").eval()
    tensors = {f"network.{name}": value for name, value in network.state_dict().items()}
    checkpoint: dict[str, Any] = {
        "state_dict": tensors | {"depth_seen": torch.zeros(2), "discriminator.weight": torch.zeros(1)},
        "hyper_parameters": {"options": {"model": {**options, "normals": "unc", "normal_frame": "camera"}}},
    }
    loaded, image = load_published(source, checkpoint), torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        for task, value in network(image).items():
            assert torch.equal(loaded(image)[task], value)
    del checkpoint["state_dict"][
        "network.head.weight" if model == "newcrfs" else "network.encoder.net.conv1.weight"
    ]
    with refused(ValueError, "state_dict", "lacks ", "weight"):
        load_published(source, checkpoint)
    with refused(ValueError, "state_dict", "monodepth_fpn", f"these are of {model}"):
        load_published("monodepth_fpn", checkpoint)


def test_files_hold_tensors_and_plain_values_alone(tmp_path: Path) -> None:
    class Payload:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "executed",))

    path = tmp_path / "some.pt"
    with refused(ValueError, "checkpoint", f"no such file: {path}"):
        read_weights(path)
    for content in (Payload(), torch.nn.Linear(1, 1), [torch.zeros(1)]):
        torch.save(content, path)
        with refused(ValueError, "checkpoint", f"{path} must ") as refusal:
            read_weights(path)
        assert "\n" not in str(refusal.value)
    assert not (tmp_path / "executed").exists()


def test_arrays_that_the_authors_keep_beside_their_weights(tmp_path: Path) -> None:
    beside = {"best_eval_steps": np.zeros(9, np.int32), "best": np.float64(0.1), "global_step": 7}
    torch.save({"model": {"weight": torch.ones(2)}, **beside}, tmp_path / "some.pt")
    assert torch.equal(read_weights(tmp_path / "some.pt")["model"]["weight"], torch.ones(2))


@needs_parity
def test_tensors_without_a_shape_are_refused() -> None:
    for name in ("decoder.upconv5.conv.weight", "decoder.reduc8x8.reduc.plane_params.weight"):
        with refused(ValueError, "state_dict"):
            load_published("bts", published_state("bts") | {name: torch.tensor(1.0)})


def test_refuses_names_that_are_none() -> None:
    with refused(ValueError, "state_dict", "it has 0"):
        tensors_of({0: torch.zeros(1)})
    with refused(ValueError, "state_dict", "got a list"):
        tensors_of([1])


@pytest.mark.parametrize("state", [{}, {"epoch": 3, "optimizer": {}}, {"model": {"weight": [1.0]}}])
def test_refuses_what_is_no_state_dict(state: dict[str, object]) -> None:
    with refused(ValueError, "state_dict", "'model' or 'state_dict'", "it has "):
        load_published("bts", state)


@needs_parity
def test_names_only_a_few_of_many_missing_weights() -> None:
    state = {name: value for name, value in published_state("bts").items() if ".bn1." not in name}
    with refused(ValueError, "state_dict", "encoder.net.bn1.weight, ", " more"):
        load_published("bts", state)


@needs_parity
@pytest.mark.parametrize(
    ("source", "other"),
    [
        ("bts", "col3d_mtl"),
        ("col3d_mtl", "bts"),
        ("col3d_mtl", "col3d_bts_cbam"),
        ("col3d_mtl_no_xtc", "col3d_mtl"),
    ],
)
def test_refuses_the_weights_of_another_method(source: str, other: str) -> None:
    with refused(ValueError, "state_dict", f"weights of {source};", other):
        load_published(source, published_state(other))


def test_unknown_source() -> None:
    with refused(OptionError, "source", "'btz'", "'bts'", "col3d_mtl_no_xtc"):
        load_published("btz", {})


@pytest.mark.parametrize(
    ("published", "standard"),
    [
        ("encoder.base_model.layer1.0.bn1.bias", "encoder.net.layer1.0.bn1.bias"),
        ("decoder.bn5.weight", "trunk.up16.norm.weight"),
        ("decoder.conv3.0.weight", "depth_decoder.up4.fuse.0.weight"),
        ("decoder.daspp_6.atrous_conv.first_bn.bias", "trunk.aspp.branches.1.norm_in.bias"),
        ("decoder.reduc8x8.reduc.plane_params.weight", "depth_decoder.plane8.reduction.out.weight"),
    ],
)
def test_names_of_bts(published: str, standard: str) -> None:
    assert our_name(published, SOURCES["bts"].rules) == standard

"""Published weights: the authors' numbers, and what the importer refuses.

The reference numbers are found through the environment variable COL3D_PARITY, the folder with `fill_rule.py`,
`state_dict_shapes.json` and one .npz per published network.
"""

import importlib.util
import json
import os
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from torch import Tensor

from col3d.models.col3d_mtl import enlarge, published_normals
from col3d.models.published import SOURCES, house_name, load_published

PARITY = os.environ.get("COL3D_PARITY")
needs_parity = pytest.mark.skipif(PARITY is None, reason="COL3D_PARITY names no folder of reference numbers")
FILES = {"bts": "bts_resnet50"}


def folder() -> Path:
    assert PARITY is not None
    return Path(PARITY)


def rule() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fill_rule", folder() / "fill_rule.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def published_state(source: str) -> dict[str, Tensor]:
    shapes = json.loads((folder() / "state_dict_shapes.json").read_text())[FILES.get(source, source)]
    values = {name: rule().fill(name, tuple(shape)) for name, shape in shapes.items()}
    return {name: torch.from_numpy(value) for name, value in values.items() if value is not None}


def assert_close(found: Tensor, expected: np.ndarray, atol: float) -> None:
    torch.testing.assert_close(found, torch.from_numpy(expected), atol=atol, rtol=0)


@needs_parity
@pytest.mark.parametrize("source", list(SOURCES))
def test_authors_numbers(source: str) -> None:
    network = load_published(source, published_state(source))
    maps: dict[str, Tensor] = {}
    for name, block in network.named_modules():
        block.register_forward_hook(lambda _, __, out, name=name: maps.update({name: out}))
    with np.load(folder() / f"{FILES.get(source, source)}.npz") as stored, torch.no_grad():
        prediction = network.forward_normalised(torch.from_numpy(rule().network_input()))
        assert_close(prediction["depth"], stored["depth"], atol=1e-3)
        for k in (8, 4, 2):
            assert_close(maps[f"depth_decoder.plane{k}"], stored[f"lpg{k}x{k}"], atol=1e-4)
        if "normals" in network.tasks:
            for k in (8, 4, 2):
                assert_close(
                    enlarge(maps[f"normal_decoder.normal{k}"], k), stored[f"normal{k}x{k}"], atol=1e-4
                )
            assert_close(published_normals(maps["normal_decoder"]), stored["normal"], atol=1e-4)
            house = stored["normal"] * np.array([1, -1, -1], np.float32)[:, None, None]
            assert_close(
                prediction["normals"], house / np.linalg.norm(house, axis=1, keepdims=True), atol=1e-4
            )


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
    ("change", "message"),
    [
        ({"decoder.extra.weight": torch.zeros(1)}, r"has unknown decoder\.extra\.weight$"),
        (
            {"decoder.get_depth.0.weight": torch.zeros(1)},
            r"decoder\.get_depth\.0\.weight \(1,\) for \(1, 32, 3, 3\)$",
        ),
        ({"decoder.get_depth.0.weight": None}, r"lacks depth_decoder\.head\.weight$"),
    ],
)
def test_refuses_what_does_not_fit(change: dict[str, Tensor | None], message: str) -> None:
    state = {name: value for name, value in (published_state("bts") | change).items() if value is not None}
    with pytest.raises(ValueError, match=rf"^state_dict: .*{message}"):
        load_published("bts", state)


@pytest.mark.parametrize("state", [{}, {"epoch": 3, "optimizer": {}}, {"model": {"weight": [1.0]}}])
def test_refuses_what_is_no_state_dict(state: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"^state_dict: must map names to tensors.*; it has .*$"):
        load_published("bts", state)


def test_names_only_a_few_of_many_missing_weights() -> None:
    with pytest.raises(ValueError, match=r"^state_dict: lacks encoder\.net\.bn1\.weight, .* and \d+ more$"):
        load_published(
            "bts", {"encoder.base_model.conv1.weight": torch.zeros(64, 3, 7, 7)}, encoder="resnet18", width=64
        )


def test_unknown_source() -> None:
    with pytest.raises(ValueError, match=r"source: 'btz' is unknown; did you mean 'bts'.*col3d_mtl_no_xtc"):
        load_published("btz", {})


@pytest.mark.parametrize(
    ("published", "house"),
    [
        ("encoder.base_model.layer1.0.bn1.bias", "encoder.net.layer1.0.bn1.bias"),
        ("decoder.bn5.weight", "trunk.up16.norm.weight"),
        ("decoder.conv3.0.weight", "depth_decoder.up4.fuse.0.weight"),
        ("decoder.daspp_6.atrous_conv.first_bn.bias", "trunk.aspp.branches.1.norm_in.bias"),
        ("decoder.reduc8x8.reduc.plane_params.weight", "depth_decoder.plane8.reduction.out.weight"),
    ],
)
def test_names_of_bts(published: str, house: str) -> None:
    assert house_name(published, SOURCES["bts"].rules) == house

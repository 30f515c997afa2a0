"""Every network in half precision: its weights are, and its outputs stay close to those in single."""

import pytest
import torch
from small import small

from col3d.inference.export.half_precision import HalfNetwork
from col3d.inference.export.traced import sample


@pytest.mark.parametrize("name", ["bts", "bts_cbam", "col3d_mtl", "newcrfs", "monodepth_fpn", "pix2pix"])
def test_networks_in_half_precision(name: str) -> None:
    torch.manual_seed(0)
    network = small(name).eval()
    half = HalfNetwork(network).eval()
    inputs = sample(network, torch.rand(2, 3, 96, 130))
    with torch.no_grad():
        expected, found = network(**inputs), half(**inputs)
    assert {values.dtype for values in half.parameters()} == {torch.float16}
    assert {values.dtype for values in network.parameters()} == {torch.float32}
    assert found.keys() == expected.keys()
    for key, values in found.items():
        assert values.dtype == torch.float32
        off = (values - expected[key]).abs().max()
        assert 0 < off < (0.5 if key == "depth" else 0.1), key

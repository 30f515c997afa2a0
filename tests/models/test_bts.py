"""BTS at its published size."""

import torch

from col3d.models.bts import BTS


def test_published_size() -> None:
    with torch.device("meta"):
        network = BTS("resnet50")
    decoder = sum(p.numel() for part in (network.trunk, network.depth_decoder) for p in part.parameters())
    encoder = sum(p.numel() for p in network.encoder.parameters())
    assert (encoder, decoder) == (23_508_032, 23_973_936)


def test_starts_in_the_middle_of_the_range() -> None:
    torch.manual_seed(0)
    depth = BTS("resnet18", width=64, max_depth=80.0).eval()(torch.rand(1, 3, 64, 64))["depth"]
    assert 10 < depth.mean() < 70


def test_deepest_map_enters_through_a_relu() -> None:
    network = BTS("resnet18", width=64).eval()
    features = network.encoder(torch.randn(1, 3, 64, 64))
    below = [*features[:4], features[4] - 2 * (features[4] == 0)]
    assert torch.equal(network.trunk(features), network.trunk(below))

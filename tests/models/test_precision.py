import pytest
import torch
from refusals import refused
from small import small

from col3d.errors import OptionError
from col3d.models import create
from col3d.registry import available


@pytest.mark.parametrize("name", available("model"))
def test_float64_is_the_twin_of_float32(name: str) -> None:
    network = small(name).eval()
    image = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        single = network(image)
        double = network.double()(image.double())
    for key, value in single.items():
        assert double[key].dtype == torch.float64
        assert torch.allclose(value.double(), double[key], atol=1e-3, rtol=1e-4)


def test_a_depth_bound_that_is_none_is_refused() -> None:
    with refused(OptionError, "model.max_depth", "greater than 0", "got 0"):
        create("bts", encoder="resnet18", width=64, max_depth=0.0)

"""Generated code computes the same, and leaves the module what it was."""

import copy
import shutil

import pytest
import torch
from torch import nn

from col3d.inference.compiled import compile_network


@pytest.mark.skipif(not shutil.which("c++"), reason="no C++ compiler")
@pytest.mark.parametrize("trained", [False, True])
def test_the_same_numbers_and_names(trained: bool) -> None:
    torch.manual_seed(0)
    layers = (nn.Conv2d(4, 8, 3, padding=1), nn.BatchNorm2d(8), nn.ELU(), nn.Conv2d(8, 4, 3, padding=1))
    plain = nn.Sequential(*layers).train(not trained)
    generated = copy.deepcopy(plain)
    compile_network(generated, trained)
    assert list(generated.state_dict()) == list(plain.state_dict())
    x = torch.randn(2, 4, 16, 20)
    with torch.set_grad_enabled(not trained):
        expected, found = plain(x), generated(x)
    torch.testing.assert_close(found, expected)
    if not trained:
        for module, out in ((plain, expected), (generated, found)):
            out.square().mean().backward()
            assert all(parameter.grad is not None for parameter in module.parameters())
        for mine, theirs in zip(generated.parameters(), plain.parameters(), strict=True):
            torch.testing.assert_close(mine.grad, theirs.grad)

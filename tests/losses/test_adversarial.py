"""The adversarial loss: a twin in numpy, and laws."""

import math

import numpy as np
import pytest
import torch

from col3d.losses.adversarial import gan_loss

LOGITS = torch.randn(2, 1, 5, 7, generator=torch.Generator().manual_seed(0)) * 4
labels = pytest.mark.parametrize("real", [True, False])


@labels
def test_gan_loss_equals_its_twin(real: bool) -> None:
    probability = 1 / (1 + np.exp(-LOGITS.double().numpy()))
    expected = -np.log(probability if real else 1 - probability).mean()
    assert gan_loss(LOGITS, real).item() == pytest.approx(expected, rel=1e-6)
    assert gan_loss(LOGITS.double(), real).item() == pytest.approx(expected, rel=1e-12)


@labels
def test_who_cannot_tell_pays_log_2(real: bool) -> None:
    assert gan_loss(torch.zeros(2, 1, 3, 3), real).item() == pytest.approx(math.log(2))


@labels
def test_who_is_sure_and_right_pays_nothing_and_who_is_wrong_pays_the_logit(real: bool) -> None:
    sure = torch.full((2, 1, 3, 3), 200.0 if real else -200.0)
    assert gan_loss(sure, real).item() == 0
    assert gan_loss(-sure, real).item() == pytest.approx(200)


def test_labels_mirror_each_other() -> None:
    torch.testing.assert_close(gan_loss(LOGITS, True), gan_loss(-LOGITS, False))
    # softplus(-x) - softplus(x) = -x
    torch.testing.assert_close(gan_loss(LOGITS, True) - gan_loss(LOGITS, False), -LOGITS.mean())


@labels
def test_gradient_is_probability_less_label(real: bool) -> None:
    logits = LOGITS.clone().requires_grad_()
    gan_loss(logits, real).backward()
    assert logits.grad is not None
    torch.testing.assert_close(logits.grad, (LOGITS.sigmoid() - float(real)) / LOGITS.numel())


@labels
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision_logits(real: bool, dtype: torch.dtype) -> None:
    half = LOGITS.to(dtype).requires_grad_()
    with torch.autocast("cpu", torch.bfloat16):
        found = gan_loss(half, real)
    found.backward()
    assert found.dtype == torch.float32
    assert torch.equal(found, gan_loss(LOGITS.to(dtype).float(), real))
    assert half.grad is not None
    assert half.grad.isfinite().all()


@labels
def test_logits_that_are_no_numbers(real: bool) -> None:
    assert gan_loss(LOGITS * float("nan"), real).isnan()

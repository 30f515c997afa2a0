"""Adversarial loss of a generator and its discriminator."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from col3d.geometry.precision import at_least_float32


def gan_loss(logits: Float[Tensor, "b *patches"], real: bool) -> Float[Tensor, ""]:
    """Mean cross-entropy of a discriminator's logits with one label: -log p(real) or -log(1 - p(real)).

    The discriminator's own loss takes the true label of each pair; the generator's takes `real=True` for its
    outputs (the non-saturating form).

    Args:
        logits: one for each patch; above 0 where the discriminator classifies it as real.
        real: the label.

    Returns:
        A scalar: log 2 for a discriminator that cannot tell, approaching zero for one that is sure and right.

    References:
        Goodfellow et al.: Generative Adversarial Nets, NeurIPS 2014, eq. 1 and section 3; Isola et al.:
        Image-to-Image Translation with Conditional Adversarial Networks, CVPR 2017, eq. 1.
    """
    logits = at_least_float32(logits)
    return binary_cross_entropy_with_logits(logits, torch.full_like(logits, float(real)))

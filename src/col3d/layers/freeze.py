"""Freeze and unfreeze parts of an encoder."""

from collections.abc import Callable, Iterable

from torch import nn

from col3d.errors import OptionError
from col3d.nearest_names import check_known


def _freeze_modules(*modules: nn.Module) -> None:
    for module in modules:
        module.requires_grad_(False)


def _batch_norms(encoder: nn.Module) -> list[nn.Module]:
    return [m for m in encoder.modules() if isinstance(m, nn.BatchNorm2d)]


def _first_conv(encoder: nn.Module) -> None:
    conv = next((m for m in encoder.modules() if isinstance(m, nn.Conv2d)), None)
    if conv is None:
        raise OptionError("model.freeze: first_conv finds no convolution in the encoder")
    _freeze_modules(conv)


def _statistics(encoder: nn.Module) -> None:
    from timm.layers import freeze_batch_norm_2d

    freeze_batch_norm_2d(encoder)


POLICIES: dict[str, Callable[[nn.Module], None]] = {
    "first_conv": _first_conv,
    "batch_norm": lambda encoder: _freeze_modules(*_batch_norms(encoder)),
    "batch_norm_statistics": _statistics,
    "encoder": _freeze_modules,
}
"""* `first_conv`: the first convolution.
* `batch_norm`: scales and offsets of the batch norms; their statistics are still those of each batch.
* `batch_norm_statistics`: also the statistics: the batch norms become fixed affine maps.
* `encoder`: every parameter."""


def freeze(network: nn.Module, policies: Iterable[str]) -> None:
    """Freeze parts of a network's encoder, in place.

    Raises:
        OptionError: a policy is unknown or finds nothing to freeze, or the network has no encoder.
    """
    policies = list(policies)
    encoder = getattr(network, "encoder", None)
    if policies and not isinstance(encoder, nn.Module):
        raise OptionError(
            f"model.freeze: {type(network).__name__} has no module `encoder`, of which parts could be kept"
        )
    encoder = encoder if isinstance(encoder, nn.Module) else nn.Identity()
    # Counted before `batch_norm_statistics` replaces them by other layers.
    has_batch_norms = bool(_batch_norms(encoder))
    for policy in policies:
        known = POLICIES[check_known("model.freeze", policy, POLICIES)]
        if policy.startswith("batch_norm") and not has_batch_norms:
            raise OptionError(f"model.freeze: {policy} finds no batch norm in the encoder")
        known(encoder)


def thaw(network: nn.Module, policies: Iterable[str]) -> None:
    """Unfreeze an encoder, except for the parts that other policies freeze."""
    network.get_submodule("encoder").requires_grad_(True)
    freeze(network, [policy for policy in policies if policy != "encoder"])


def check_learns(network: nn.Module) -> None:
    """Refuse a network without a trainable parameter.

    Raises:
        OptionError: says whether it has no parameters, or all are frozen.
    """
    parameters = list(network.parameters())
    if not any(parameter.requires_grad for parameter in parameters):
        why = "keeps all its parameters" if parameters else "has no parameters"
        raise OptionError(f"model: {type(network).__name__} {why}: there is nothing to train")

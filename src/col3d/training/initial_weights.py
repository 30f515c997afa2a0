"""Initialisation of a network by the matching tensors of another checkpoint."""

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from torch import Tensor, nn

from col3d.errors import UserError
from col3d.inference.trained_network import published_network, read_file
from col3d.layers.weight_file import check_finite, check_fractions
from col3d.models.published import OURS
from col3d.training.options import InitOptions

COLUMNS = ("taken", "not there", "of another shape there", "not used")
SHAPES = 6
"""Number of tensors of another shape that are listed."""


def begin_from(network: nn.Module, options: InitOptions, say: Callable[[str], None] = print) -> None:
    """Load those tensors of a checkpoint into a network that match it in name and shape.

    Args:
        network: the network.
        options: name of the checkpoint; without one, nothing is done.
        say: called with lines that report how many tensors were taken, and which were not.

    Raises:
        UserError: the file holds no weights, damaged ones, or none that fit.
    """
    if options.checkpoint is None:
        return
    given, wanted = checked_weights(options), network.state_dict()
    shared = [name for name in wanted if name in given]
    fitting = {name: given[name] for name in shared if given[name].shape == wanted[name].shape}
    if not any(name in fitting for name, _ in network.named_parameters()):
        raise UserError(
            f"init.checkpoint: none of the {len(given)} tensors in {options.checkpoint} fits this network; "
            "begin from a checkpoint of the same model and encoder"
        )
    try:
        check_fractions(fitting, wanted)
    except ValueError as error:
        raise UserError(f"init.checkpoint: {options.checkpoint}: {error}") from None
    network.load_state_dict(fitting, strict=False)
    say(f"begins from {len(fitting)} of {len(wanted)} tensors of {options.checkpoint}")
    for line in _table(network.state_dict(), given):
        say(line)


def checked_weights(options: InitOptions) -> Mapping[str, Tensor]:
    """Read the tensors of the file; errors name the option `init.checkpoint`."""
    try:
        return _tensors(options)
    except UserError as error:
        message = str(error).removeprefix("init.checkpoint: ").removeprefix("checkpoint: ")
        raise UserError(f"init.checkpoint: {message}") from None


def _tensors(options: InitOptions) -> Mapping[str, Tensor]:
    path = Path(str(options.checkpoint))
    if options.published is not None:
        return published_network(path, options.published).state_dict()
    content = read_file(path)
    state = content.get("state_dict")
    named = state if isinstance(state, Mapping) else {}
    ours = {name.removeprefix(OURS): values for name, values in named.items() if str(name).startswith(OURS)}
    if not ours:
        raise UserError(
            f"{path} is not a checkpoint of train.py; for the authors' weights say init.published=<whose>"
        )
    try:
        check_finite(ours)
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    return ours


def _table(wanted: Mapping[str, Tensor], given: Mapping[str, Tensor]) -> list[str]:
    """Format the tensors that were not taken, by part, and some of other shapes; empty if all were taken."""
    kinds: dict[str, Counter[str]] = {kind: Counter() for kind in COLUMNS}
    reshaped = []
    for name in {**wanted, **given}:
        part = name.partition(".")[0]
        if name not in wanted:
            kinds["not used"][part] += 1
        elif name not in given:
            kinds["not there"][part] += 1
        elif given[name].shape != wanted[name].shape:
            kinds["of another shape there"][part] += 1
            reshaped.append(f"{name} {tuple(wanted[name].shape)}, there {tuple(given[name].shape)}")
        else:
            kinds["taken"][part] += 1
    parts = list(dict.fromkeys(name.partition(".")[0] for name in {**wanted, **given}))
    if not any(counts for kind, counts in kinds.items() if kind != "taken"):
        return []
    width = max(map(len, [*parts, "tensors"]))
    rows = ["  ".join(str(kinds[kind][part]).rjust(len(kind)) for kind in COLUMNS) for part in parts]
    more = [] if len(reshaped) <= SHAPES else [f"and {len(reshaped) - SHAPES} more"]
    return [
        f"  {'tensors'.ljust(width)}  {'  '.join(COLUMNS)}",
        *(f"  {part.ljust(width)}  {row}" for part, row in zip(parts, rows, strict=True)),
        *(f"  {line}" for line in [*reshaped[:SHAPES], *more]),
        "  what was not taken is as it was initialised",
    ]

"""Options of a loss: named terms, each a registered function, and their weights."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, PlainValidator, SerializeAsAny

from col3d.errors import OptionError
from col3d.registry import BALANCERS, LOSSES, Part
from col3d.registry.fields import NonNegative
from col3d.registry.schema import Options, defaults

USUAL = "fixed"
"""Name of the balancer of a loss without `balance`."""


class TermOptions(Options):
    """A term, and the epoch from which it counts; the parameters of its function join these."""

    term: str
    from_epoch: Annotated[int, Field(ge=0)] = 0

    def __str__(self) -> str:
        """Name of the term, with the options that differ from their defaults."""
        usual = {name: default for name, (_, default) in LOSSES[self.term].parameters().items()}
        given = own_options(self)
        changed = [f"{name}={value}" for name, value in given.items() if value != usual[name]]
        return f"{self.term}({', '.join(changed)})" if changed else self.term


def term_options(given: Any) -> TermOptions:
    """Options of a registered term, checked against its signature; a name alone takes its defaults.

    Raises:
        ValueError: nothing has that name; pydantic's for single options.
    """
    if isinstance(given, TermOptions):
        return given
    content = {"term": given} if isinstance(given, str) else given
    if not isinstance(content, Mapping) or not isinstance(content.get("term"), str):
        raise OptionError(f"loss.terms: a term is a name or {{term: NAME, ...}}, got {given!r}")
    options = LOSSES[content["term"]].options(TermOptions).model_validate(content)
    assert isinstance(options, TermOptions)
    return options


def own_options(options: TermOptions) -> dict[str, Any]:
    """Options of the term's function."""
    return LOSSES[options.term].own(options)


Term = Annotated[SerializeAsAny[TermOptions], PlainValidator(term_options)]


class BalanceOptions(Options):
    """How terms and lambdas become one number; the parameters of the balancer join this."""

    name: str


def balance_options(given: Any) -> BalanceOptions | None:
    """Options of a registered balancer, checked against its signature; None for the sum as it is.

    Raises:
        ValueError: nothing has that name; pydantic's for single options.
    """
    if given is None or isinstance(given, BalanceOptions):
        return given
    if not isinstance(given, Mapping) or not isinstance(given.get("name"), str):
        raise OptionError(f"loss.balance: expected {{name: NAME, ...}}, got {given!r}")
    options = BALANCERS[given["name"]].options(BalanceOptions).model_validate(given)
    assert isinstance(options, BalanceOptions)
    return None if options == BalanceOptions(name=USUAL) else options


def balancer(options: BalanceOptions | None) -> Any:
    """Build the balancer that the options name; the weighted sum for None."""
    options = options or BalanceOptions(name=USUAL)
    part = BALANCERS[options.name]
    return part.build(**part.own(options))


def balance_node(part: Part) -> dict[str, Any]:
    """Configuration node of `loss/balance=NAME`: every option with its default."""
    return {"name": part.name, **defaults(part.parameters())}


Balance = Annotated[SerializeAsAny[BalanceOptions] | None, PlainValidator(balance_options)]


class LossOptions(Options):
    """Terms of `col3d.losses.WeightedLoss` by name, and a weight for each, in their order."""

    lambdas: list[NonNegative]
    terms: Annotated[dict[str, Term], Field(min_length=1)]
    balance: Balance = None

    def needing(self, task: str) -> list[str]:
        """Names of the terms that need a task of the network's prediction."""
        return [name for name, options in self.terms.items() if task in LOSSES[options.term].facts["needs"]]

    def learning_from(self, truth: str) -> list[str]:
        """Names of the terms that need a task of the ground truth."""
        return [name for name, options in self.terms.items() if truth in LOSSES[options.term].facts["truth"]]

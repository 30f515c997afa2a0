"""Parts by name: what a registration takes, what its signature checks, and what it refuses."""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, ValidationError
from refusals import refused
from torch import nn

from col3d.errors import OptionError
from col3d.models import create
from col3d.models.options import ModelOptions, model_options, node
from col3d.registry import KINDS, MODELS, Part, Registry, available, describe
from col3d.registry.schema import Options, SignatureError, options_of, parameters


class Net(nn.Module):
    """A network of somebody's.

    More is said here.
    """

    def __init__(
        self,
        channels: Sequence[int] = (8, 16),
        dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0,
        mode: Literal["fast", "good"] = "fast",
        weights: Path | None = None,
        norm: type[nn.Module] = nn.BatchNorm2d,
    ) -> None:
        super().__init__()
        self.given = (channels, dropout, mode, weights, norm)


@pytest.fixture
def nets() -> Registry:
    """The registry of networks with one more."""
    MODELS.register("net", Net, predicts=("depth",), depth_alone=None, presets={})
    return MODELS


def test_options_are_the_plain_parameters_with_their_defaults() -> None:
    assert {name: default for name, (_, default) in parameters(Net).items()} == {
        "channels": (8, 16),
        "dropout": 0.0,
        "mode": "fast",
        "weights": None,
    }


@pytest.mark.parametrize(
    ("given", "place", "kind"),
    [
        ({"dropout": 1}, ("dropout",), "less_than"),
        ({"dropout": "much"}, ("dropout",), "float_parsing"),
        ({"channels": 3}, ("channels",), "is_instance_of"),
        ({"channels": ["a"]}, ("channels", 0), "int_parsing"),
        ({"mode": "best"}, ("mode",), "literal_error"),
        ({"dropuot": 0.1}, ("dropuot",), "extra_forbidden"),
        ({"norm": "BatchNorm2d"}, ("norm",), "extra_forbidden"),
        ({"dropout": 1e300}, ("dropout",), "less_than"),
    ],
)
def test_values_are_held_against_the_signature(
    given: dict[str, Any], place: tuple[Any, ...], kind: str
) -> None:
    with pytest.raises(ValidationError) as error:
        options_of(Net).model_validate(given)
    assert [(detail["loc"], detail["type"]) for detail in error.value.errors()] == [(place, kind)]


def test_none_as_a_word_is_nothing_where_nothing_is_allowed() -> None:
    options: Any = options_of(Net).model_validate({"weights": "none", "channels": [4]})
    assert (options.weights, list(options.channels)) == (None, [4])


def test_a_default_that_breaks_its_own_rule_is_refused() -> None:
    def net(rate: Annotated[float, Field(gt=0)] = -1.0) -> None: ...

    with refused(ValidationError, None, "rate", "type=greater_than"):
        options_of(net).model_validate({})


def test_a_parameter_without_default_is_needed() -> None:
    def net(depth: int) -> None: ...

    with refused(ValidationError, None, "depth", "type=missing"):
        options_of(net).model_validate({})


@pytest.mark.parametrize("name", ["copy", "json", "model_name", "schema"])
def test_a_parameter_may_be_called_as_a_method_of_pydantic_s(name: str) -> None:
    scope: dict[str, Any] = {}
    exec(f"def net({name}: int = 3): ...", scope)
    assert options_of(scope["net"]).model_validate({name: 4}).model_dump() == {name: 4}


def test_what_no_option_can_set_is_said_with_the_place() -> None:
    def net(backbone: nn.Module) -> None: ...

    with refused(SignatureError, None, "test_registry.", ".net: ", "'backbone'"):
        MODELS.register("net", net)

    def other(width: "Nowhere" = 3) -> None: ...  # type: ignore[name-defined]

    with refused(SignatureError, None, ".other: ", "'Nowhere'"):
        parameters(other)


@pytest.mark.parametrize("name", ["my-net", "", "1net", "a.b", "a/b", "a b"])
def test_a_name_is_one_that_a_command_line_can_say(name: str) -> None:
    with refused(ValueError, "register_model", repr(name)):
        MODELS.register(name, Net)


def test_a_name_is_given_once(nets: Registry) -> None:
    nets.register("net", Net)  # a module that is imported again

    class Other(nn.Module): ...

    with refused(ValueError, "register_model", "'net'", "test_registry.Net", "<locals>.Other"):
        nets.register("net", Other)


def test_who_takes_a_name_of_ours_is_told_to_rename(nets: Registry) -> None:
    named = ("'bts'", "col3d.models.bts.BTS", "test_registry.Net")
    with refused(ValueError, "register_model", *named):
        nets.register("bts", Net)
    ours = nets.parts["bts"].build
    nets.parts["bts"] = Part("model", "bts", Net)  # a plugin that was loaded before our own parts
    with refused(ValueError, "register_model", *named):
        nets.register("bts", ours)


class Maker:
    """Makes networks."""

    def __call__(self, width: Annotated[int, Field(gt=0)] = 3) -> nn.Module: ...


@pytest.mark.parametrize(
    ("build", "place", "option"),
    [
        (functools.partial(Net, dropout=0.25), "test_registry.Net", "model.dropout: float, ge=0, lt=1; 0.25"),
        (functools.partial(Maker().__call__), "test_registry.Maker.__call__", "model.width: int, gt=0; 3"),
        (functools.partial(Maker()), "test_registry.Maker", "model.width: int, gt=0; 3"),
        (Maker(), "test_registry.Maker", "model.width: int, gt=0; 3"),
    ],
)
def test_whatever_can_be_called_can_be_registered(
    nets: Registry, build: Any, place: str, option: str
) -> None:
    nets.register("called", build, predicts=("depth",), presets={})
    said = describe("model", "called")
    assert said.startswith(f"model called ({place})")
    assert option in said
    assert model_options({"name": "called"}).name == "called"


@pytest.mark.parametrize(
    ("kind", "option"),
    [
        ("model", "model.name"),
        ("loss", "loss.terms.ENTRY.from_epoch"),
        ("balancer", "loss.balance.name"),
        ("dataset", "data.split"),
        ("optimizer", "optimizer.layer_decay"),
        ("scheduler", "scheduler.interval"),
        ("callback", "callbacks.more.ENTRY.callback"),
    ],
)
def test_no_parameter_is_called_as_an_option_of_the_program(kind: str, option: str) -> None:
    scope: dict[str, Any] = {"__name__": "theirs"}
    exec(f"def part({option.rpartition('.')[2]}: int = 3): ...", scope)
    with refused(SignatureError, "theirs.part", repr(option.rpartition(".")[2]), option, kind):
        KINDS[kind].register("theirs", scope["part"])


def test_what_a_function_gives_is_of_its_kind(nets: Registry) -> None:
    def nothing(width: int = 3) -> None: ...

    nets.register("nothing", nothing, predicts=("depth",), presets={})
    with refused(OptionError, "model nothing", ".nothing", "NoneType"):
        create("nothing")


def test_an_empty_path_is_no_path() -> None:
    def net(weights: Path = Path("a"), other: Path | None = None) -> None: ...

    for name in ("weights", "other"):
        with refused(ValidationError, None, f"\n{name}\n", "type=no_text"):
            options_of(net).model_validate({name: ""})


def test_a_decorator_leaves_the_class_as_it_is(nets: Registry) -> None:
    assert nets.register("again")(Net) is Net
    assert nets["again"].build is Net


def test_a_network_without_any_of_ours_is_created_and_described(nets: Registry) -> None:
    made = create("net", dropout="0.5", norm=nn.InstanceNorm2d)
    assert made.given == ((8, 16), 0.5, "fast", None, nn.InstanceNorm2d)
    assert made.tasks == ("depth",)
    said = describe("model", "net")
    assert "A network of somebody's." in said
    assert "model.dropout: float, ge=0, lt=1; 0.0 unless given" in said
    assert "norm" not in said


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        ({"dropuot": 0.1}, "model.dropuot", ("'model.dropout'",)),
        ({"dropout": 2}, "model.dropout", ("less than 1", "got 2")),
        ({"normals": "unc"}, "model.normals", ("net ", "col3d.layers.network.DepthNetwork")),
        ({"normals": "some"}, "model.normals", ("'some'", "none, unc")),
        ({"normal_frame": "ray"}, "model.normal_frame", ("ray", "normals=unc")),
    ],
)
def test_what_a_network_is_not_is_one_line(
    nets: Registry, options: dict[str, Any], about: str, named: tuple[str, ...]
) -> None:
    with refused(OptionError, about, *named) as error:
        create("net", **options)
    assert "\n" not in str(error.value)


def test_an_error_of_the_network_s_own_code_is_not_ours(nets: Registry) -> None:
    def broken(width: int = 3) -> nn.Module:
        raise ValueError(f"no {width}")

    nets.register("broken", broken, predicts=("depth",), depth_alone=None, presets={})
    with refused(ValueError, None, "no 3") as error:
        create("broken")
    assert not isinstance(error.value, OptionError)


def test_options_of_a_configuration_are_those_of_the_named_network(nets: Registry) -> None:
    options: Any = model_options({"name": "net", "dropout": 0.25})
    assert isinstance(options, ModelOptions)
    assert options.model_dump(mode="json") == {
        **{"name": "net", "max_depth": 100.0, "normals": "none", "normal_frame": "camera", "freeze": []},
        "unfreeze_at": None,
        **{"channels": [8, 16], "dropout": 0.25, "mode": "fast", "weights": None},
    }
    assert node(nets["net"])["channels"] == [8, 16]
    with refused(OptionError, "model.name", "'nte'", "'net'"):
        model_options({"name": "nte"})


def test_a_group_of_options_has_no_more_than_its_own() -> None:
    class Group(Options):
        rate: float = 0.1

    with refused(ValidationError, None, "rates", "type=extra_forbidden"):
        Group.model_validate({"rates": 1})


def test_every_network_here_says_in_a_line_what_it_is() -> None:
    for name in available("model"):
        assert MODELS[name].summary.endswith("."), name
        assert MODELS[name].package == "col3d"

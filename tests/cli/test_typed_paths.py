"""Paths and names reach a program as they are typed, or a line says how to quote them."""

import random
import shlex
from pathlib import Path

import pytest
from hydra import initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import OverrideParseException
from omegaconf import OmegaConf
from pydantic import BaseModel

from col3d.cli.files import CONF
from col3d.cli.paths import MAY_BE_NULL, NAMES, PATHS, as_typed, quoted, quoted_again
from col3d.cli.program import composed
from col3d.cli.refusals import explain
from col3d.cli.sweeps import jobs_of
from col3d.data.cache.options import PrepareOptions
from col3d.data.checks.options import VerifyOptions
from col3d.data.options import SourceOptions
from col3d.evaluation.options import EvaluateOptions
from col3d.inference.options import DemoOptions, ExportOptions, FuseOptions, PredictOptions
from col3d.models.options import ModelOptions
from col3d.registry import DATASETS, MODELS, available
from col3d.training.options import BenchmarkFile, TrainOptions

NASTY = " ()[]{}=,#&~:;'\"\\$%@!?*+-^`|<>äß鏡0e1._"
TYPED = (
    *("frame (1).png", "Müller.png", "内視鏡.png", "a=b.png", "a,b.png", "patient [2].png", "it's.png"),
    *("a#1.png", "a&b.png", "a~b.png", "{}.png", "rgb_{}.png", "C:\\data\\new", "ends with \\"),
    *("123", "007", "1e5", "1_000", "-1", "null", "true", "nan", "[a]", "{a: b}", "a b", " led by space"),
    *("'", "a'b", '"', "a\\'b", "é", "both ' and \""),
)


def read_back(argument: str) -> object:
    override = OverridesParser.create().parse_override(argument)
    assert not override.is_sweep_override()
    return override.value()


@pytest.mark.parametrize("value", TYPED)
@pytest.mark.parametrize("option", ["input", "data.root", "+data.layout.depth", "hydra.run.dir"])
def test_a_path_is_what_was_typed(option: str, value: str) -> None:
    (argument,) = as_typed([f"{option}={value}"], "predict")
    assert read_back(argument) == value


def test_any_text_comes_back_from_its_quotes() -> None:
    draw = random.Random(0)
    for _ in range(300):
        value = "".join(draw.choice(NASTY) for _ in range(draw.randint(1, 12)))
        if "${" not in value:
            assert read_back(f"input={quoted(value)}") == value


@pytest.mark.parametrize("value", TYPED)
def test_a_composed_option_is_what_was_typed(value: str) -> None:
    overrides = as_typed([f"input={value}", "output=out"], "predict")
    with initialize_config_dir(str(CONF), version_base="1.3"):
        assert composed("predict", overrides)["input"] == value


def test_names_in_lists_stay_names() -> None:
    typed = "data.split.train=[001,7,1e3,null,clip 1,cecum_t1_a:0-120,'b c',no(1)]"
    (argument,) = as_typed([typed], "train")
    names = ["001", "7", "1e3", "null", "clip 1", "cecum_t1_a:0-120", "b c", "no(1)"]
    assert OmegaConf.create({"x": read_back(argument)})["x"] == names


@pytest.mark.parametrize(
    "argument",
    [
        *("camera=[520,520,319.5,239.5]", "checkpoint=null", "output_dir=null", "samples=none", "video=true"),
        *(
            "input='a b.png'",
            'input="a b.png"',
            "output_dir=runs/${now:%H}",
            "loss.lambdas=[0.5,0.3,0.2]",
            "seed=7",
        ),
        *("input=frames/*.jpg", "data.root=/data/C3VD", "--fast", "model=bts", "data.split.train=[a,b]"),
    ],
)
def test_what_hydra_reads_rightly_is_left_as_it_is(argument: str) -> None:
    assert as_typed([argument], "predict") == [argument]


def test_commas_separate_in_a_sweep() -> None:
    sweep = ["-m", "model.pretrained=none,imagenet", "data.root=/a/b (1)"]
    assert as_typed(sweep, "train") == ["-m", "model.pretrained=none,imagenet", 'data.root="/a/b (1)"']


def swept(argument: str) -> list[object]:
    (override,) = OverridesParser.create().parse_overrides([argument])
    assert override.is_sweep_override()
    return [read_back(f"x={entry}") for entry in override.sweep_string_iterator()]


@pytest.mark.parametrize("typed", ["['c,d']", '["c,d"]', '[a, "c,d", it\'s, null]', "[it's,no]"])
def test_a_comma_inside_of_a_quoted_name_is_of_the_name(typed: str) -> None:
    (argument,) = as_typed([f"data.split.test={typed}"], "train")
    names = {"['c,d']": ["c,d"], '["c,d"]': ["c,d"], "[it's,no]": ["it's", "no"]}
    came = OmegaConf.create({"x": read_back(argument)})["x"]
    assert came == names.get(typed, ["a", "c,d", "it's", "null"])


@pytest.mark.parametrize("option", ["videos", "data.split.test"])
@pytest.mark.parametrize(
    "name",
    [
        "it's",
        "a b",
        "001",
        "-x",
        "a=b",
        "null",
        "true",
        "1e3",
        "内視鏡",
        "v.",
        "no(1)",
        "#1",
        "a\\",
        "[a]",
        "a\\b",
    ],
)
def test_a_name_in_a_list_is_what_was_typed(option: str, name: str) -> None:
    (argument,) = as_typed([f"{option}=[{name},b]"], "download")
    assert OmegaConf.create({"x": read_back(argument)})["x"] == [name, "b"]


def test_an_empty_list_of_names_stays_empty() -> None:
    assert as_typed(["data.split.test=[]"], "train") == ["data.split.test=[]"]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("[001,1e5],[null,true]", [["001", "1e5"], ["null", "true"]]),
        ("[a b],[it's, 7]", [["a b"], ["it's", "7"]]),
    ],
)
def test_names_of_lists_in_a_sweep_stay_names(typed: str, expected: list[list[str]]) -> None:
    _, argument = as_typed(["-m", f"data.split.train={typed}"], "train")
    assert [OmegaConf.create({"x": names})["x"] for names in swept(argument)] == expected


def test_one_list_of_names_in_a_sweep_is_one_value() -> None:
    _, argument = as_typed(["-m", "data.split.train=[001,1e5,null]"], "train")
    assert OmegaConf.create({"x": read_back(argument)})["x"] == ["001", "1e5", "null"]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("data.root=/a (1),/b=c,007", ["/a (1)", "/b=c", "007"]),
        ("data.root=1e5,null", ["1e5", "null"]),
        ("init.checkpoint=null,/x y.ckpt", [None, "/x y.ckpt"]),
        ("data.root='/a,b',/c", ["/a,b", "/c"]),
    ],
)
def test_paths_in_a_sweep_stay_paths(typed: str, expected: list[str | None]) -> None:
    _, argument = as_typed(["-m", typed], "train")
    assert swept(argument) == expected


@pytest.mark.parametrize("value", TYPED)
def test_a_job_of_a_sweep_that_starts_a_process_of_its_own_hands_on_what_was_typed(value: str) -> None:
    """Hydra's sweeper writes overrides with backslashes, where a command line has quotes."""
    typed = as_typed(
        ["-m", f"data.root={quoted(value)}", f"data.split.test=[{quoted(value)},a:0-2]"], "train"
    )
    swept = OverridesParser.create().parse_overrides([*typed[1:], "seed=0,1"])
    jobs = jobs_of({}, swept)
    assert len(jobs) == 2
    for job in jobs:
        root, test, _ = as_typed(quoted_again(job), "train")
        assert (read_back(root), read_back(test)) == (value, [value, "a:0-2"])


def test_searches_of_a_sweep_are_left_as_they_are() -> None:
    argument = "data.root=choice(/a,/b)"
    assert as_typed(["-m", argument], "train") == ["-m", argument]


@pytest.mark.parametrize("argument", ["seed=a(1)", "model.encoder=Müller", "preset=#1"])
def test_what_cannot_be_read_is_shown_quoted_rightly(argument: str) -> None:
    with pytest.raises(OverrideParseException) as error:
        OverridesParser.create().parse_overrides([argument])
    option, _, value = argument.partition("=")
    advice = explain(error.value, "train").rpartition(": ")[2]
    assert read_back(shlex.split(advice)[0]) == value
    assert shlex.split(advice)[0].startswith(f"{option}=")


def text_options(model: type[BaseModel], prefix: str = "") -> dict[str, bool]:
    """Options whose value is free text, and whether they may be null."""
    found = {}
    for name, field in model.model_fields.items():
        said, place = str(field.annotation), f"{prefix}{name}"
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            found |= text_options(inner, f"{place}.")
        elif inner is str or said in ("str | None", "typing.Optional[str]"):
            found[place] = "None" in said
    return found


NO_PATH = {"preset", "prepare.preset", "data.name", "data.split.name", "dataset", "name"}
NO_PATH |= {"optimizer.name", "scheduler.name"}
NO_PATH |= {f"model.{name}" for name in ("name", "encoder", "heads", "pyramid_norm")}
"""Free text that is a name of ours."""


@pytest.mark.parametrize(
    "model",
    [
        *(EvaluateOptions, PredictOptions, FuseOptions, ExportOptions),
        *(
            DemoOptions,
            PrepareOptions,
            VerifyOptions,
            BenchmarkFile,
            TrainOptions,
        ),
    ],
)
def test_no_option_that_is_a_path_is_forgotten(model: type[BaseModel]) -> None:
    for option, nullable in text_options(model).items():
        if option in NO_PATH or option.startswith("logger."):
            continue
        assert PATHS.fullmatch(option), option
        assert nullable is False or option in MAY_BE_NULL, option


@pytest.mark.parametrize("name", available("dataset"))
def test_no_option_of_a_data_set_that_is_a_path_is_forgotten(name: str) -> None:
    for option in text_options(DATASETS[name].options(SourceOptions), "data."):
        assert option in NO_PATH or PATHS.fullmatch(option), option


@pytest.mark.parametrize("name", available("model"))
def test_no_option_of_a_network_that_is_a_path_is_forgotten(name: str) -> None:
    for option, nullable in text_options(MODELS[name].options(ModelOptions), "model.").items():
        assert option in NO_PATH or PATHS.fullmatch(option), option
        assert option in NO_PATH or nullable is False or option in MAY_BE_NULL, option


def test_data_sets_beside_have_paths_too() -> None:
    assert PATHS.fullmatch("data.also.simcol3d.root")
    assert PATHS.fullmatch("data.test.layout.image")
    assert NAMES.fullmatch("data.also.c3vdv2.split.train")
    assert Path(CONF).is_dir()

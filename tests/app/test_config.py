from pathlib import Path
from typing import Any, get_args

import pytest
from tiny_run import CONF, composed

from col3d.app.config import EvaluateOptions, ModelOptions, PrepareOptions, TrainOptions
from col3d.app.errors import check_options
from col3d.checks import UserError
from col3d.data.splits import paper_split
from col3d.models import NETWORKS

GROUPS = sorted(
    path.name for path in CONF.iterdir() if path.is_dir() and path.name not in ("data", "experiment")
)
CHOICES = [f"{group}={path.stem}" for group in GROUPS for path in sorted((CONF / group).glob("*.yaml"))]
EXPERIMENTS = [f"experiment={path.stem}" for path in sorted((CONF / "experiment").glob("*.yaml"))]


def checked(*overrides: str) -> TrainOptions:
    return check_options(TrainOptions, {**composed("train", "output_dir=runs/x", *overrides)})


@pytest.mark.parametrize("choice", [*CHOICES, *EXPERIMENTS])
def test_every_file_composes_into_valid_options(choice: str) -> None:
    if choice.startswith("loss="):
        checked(choice, "model=col3d_mtl")
    else:
        checked(choice)


def test_the_other_entry_points_compose() -> None:
    check_options(EvaluateOptions, composed("evaluate", "checkpoint=x.ckpt"))
    assert check_options(PrepareOptions, composed("prepare")).data.name == "phantom"
    assert check_options(PrepareOptions, composed("prepare", "phantom=smoke")).phantom.size == [135, 169]


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        ("bts", ["depth"]),
        ("bts_cbam", ["depth"]),
        ("bts_cbam_mtl", ["depth", "normals"]),
        ("col3d_mtl", ["depth", "normals", "consistency"]),
    ],
)
def test_a_model_brings_its_loss(model: str, terms: list[str]) -> None:
    assert checked(f"model={model}").loss.terms == terms


def test_a_loss_on_the_command_line_wins_wherever_it_stands() -> None:
    assert checked("model=col3d_mtl", "loss=silog").loss.terms == ["depth"]
    assert checked("loss=mtl", "model=col3d_mtl").loss.terms == ["depth", "normals"]
    assert checked("model=col3d_mtl", "loss.lambdas=[0.4,0.3,0.3]").loss.lambdas == [0.4, 0.3, 0.3]


def test_the_paper_preset_is_the_paper() -> None:
    options = checked("preset=paper")
    assert (options.model.encoder, options.model.width) == ("resnet50", 512)
    assert (options.data.size, options.data.batch_size) == ([320, 320], 8)
    assert (options.optimizer.name, options.optimizer.lr, options.optimizer.weight_decay) == (
        "adamw",
        1e-4,
        1e-2,
    )
    assert (options.scheduler.name, options.trainer.max_epochs) == ("polynomial", 50)
    augment = options.data.augment
    assert (augment.rotation, augment.flip, augment.jitter) == (1.0, 0.0, 0.0)


def test_presets_keep_the_chosen_data() -> None:
    for preset in ("smoke", "laptop", "paper"):
        options = checked(f"preset={preset}", "data=c3vd", "data.root=somewhere")
        assert (options.data.name, options.data.root) == ("c3vd", "somewhere")


def test_the_split_file_is_the_paper_s() -> None:
    split = checked().data.split
    assert {part: getattr(split, part) for part in ("train", "val", "test")} == paper_split()


def test_names_in_the_options_are_those_that_can_be_built() -> None:
    assert set(get_args(ModelOptions.model_fields["name"].annotation)) == set(NETWORKS)
    assert {path.stem for path in (CONF / "model").glob("*.yaml")} == set(NETWORKS)


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (
            ["loss.lambdas=[0.5,0.3]"],
            ["loss.lambdas", "3 weight(s)", "depth, normals, consistency", "[0.5, 0.3]"],
        ),
        (["model=bts", "loss.lambdas=[1,1,1]"], ["loss.lambdas", "expected 1", "model=bts"]),
        (["model=bts", "loss=mtl_xtc"], ["normals and consistency", "model=bts predicts no normals"]),
        (["loss.lambdas=[0,0,0]"], ["loss.lambdas", "above 0"]),
        (["loss.lambdas=[0.5,-0.3,0.2]"], ["loss.lambdas.1", "greater than or equal to 0", "-0.3"]),
        (["loss.lambdas=[a,0.3,0.2]"], ["loss.lambdas.0", "number", "'a'"]),
        (["loss.lambdas=[.nan,0.3,0.2]"], ["loss.lambdas.0"]),
        (["+loss.lamdbas=[1,1,1]"], ["loss.lamdbas: no such option", "loss.lambdas"]),
        (["+trainer.max_epoch=3"], ["trainer.max_epoch: no such option", "trainer.max_epochs"]),
        (["+sed=3"], ["sed: no such option", "seed"]),
        (["model.width=eight"], ["model.width", "integer", "'eight'"]),
        (["model.width=8.5"], ["model.width", "8.5"]),
        (["model.width=100"], ["model.width", "multiple of 64", "100"]),
        (["data.size=[320]"], ["data.size", "2 items"]),
        (["data.size=[320,8]"], ["data.size.1", "64"]),
        (["data.normals=none"], ["data.normals", "needs normals"]),
        (["trainer.precision=half"], ["trainer.precision", "'half'", "bf16-mixed"]),
        (["seed=-1"], ["seed", "-1"]),
        (["loss.geometry=fisheye"], ["loss.geometry", "rays", "'fisheye'"]),
        (
            ["data/split=custom", "data.split.train=[a]", "data.split.val=[]", "data.split.test=[b]"],
            ["data.split.val"],
        ),
    ],
)
def test_each_mistake_is_one_line(overrides: list[str], expected: list[str]) -> None:
    with pytest.raises(UserError) as refusal:
        checked(*overrides)
    message = str(refusal.value)
    assert "\n" not in message
    for part in expected:
        assert part in message


def test_every_mistake_gets_its_own_line() -> None:
    with pytest.raises(UserError) as refusal:
        checked("seed=-1", "model.width=eight")
    assert len(str(refusal.value).splitlines()) == 2


def test_no_option_is_without_effect() -> None:
    """Every declared option is read somewhere in the package beside its declaration."""
    package = Path(__file__).parents[2] / "src" / "col3d" / "app"
    code = "".join(path.read_text() for path in package.glob("*.py") if path.name != "config.py")
    code += (package / "config.py").read_text().split("class TrainOptions")[1]

    def names(options: Any) -> list[str]:
        inner = [f.annotation for f in options.model_fields.values() if hasattr(f.annotation, "model_fields")]
        return [*options.model_fields, *(name for nested in inner for name in names(nested))]

    spread_whole = {"rotation", "flip", "jitter"}  # handed to Augment as they are
    for name in set(names(TrainOptions)) - spread_whole - {"preset"}:
        assert f".{name}" in code or f'"{name}"' in code, name

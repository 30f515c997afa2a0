from dis import get_instructions
from importlib.util import find_spec
from inspect import CO_OPTIMIZED
from pkgutil import walk_packages
from types import CodeType
from typing import Any, get_args

import pytest
from omegaconf.errors import InterpolationResolutionError
from refusals import refused
from tiny_run import composed

import col3d
from col3d.cli.files import CONF
from col3d.data.cache.options import PrepareOptions
from col3d.data.datasets.registered import LayoutOptions
from col3d.data.options import AugmentOptions
from col3d.data.splits import paper_split
from col3d.errors import UserError
from col3d.evaluation.options import EvaluateOptions
from col3d.evaluation.scored_part import Scored
from col3d.losses.options import LossOptions
from col3d.models.options import ModelOptions
from col3d.registry import available
from col3d.registry.refusals import check_options
from col3d.training.optimizers import OptimizerOptions
from col3d.training.options import TrainOptions
from col3d.training.schedulers import SchedulerOptions

GROUPS = sorted(
    path.name for path in CONF.iterdir() if path.is_dir() and path.name not in ("data", "experiment")
)
CHOICES = [
    *(f"{group}={path.stem}" for group in GROUPS for path in sorted((CONF / group).glob("*.yaml"))),
    *(f"model={name}" for name in available("model")),
]
EXPERIMENTS = [
    f"experiment={path.relative_to(CONF / 'experiment').with_suffix('')}"
    for path in sorted((CONF / "experiment").rglob("*.yaml"))
]


def checked(*overrides: str) -> TrainOptions:
    return check_options(TrainOptions, {**composed("train", "output_dir=runs/x", *overrides)})


@pytest.mark.parametrize("choice", [*CHOICES, *EXPERIMENTS])
def test_every_file_composes_into_valid_options(choice: str) -> None:
    if choice.startswith("loss="):
        checked(choice, "model=col3d_mtl" if "mtl" in choice else "model=bts")
    elif choice.startswith("protocol="):
        check_options(EvaluateOptions, composed("evaluate", "checkpoint=x.ckpt", choice))
    else:
        checked(choice)


@pytest.mark.parametrize("model", available("model"))
def test_a_recipe_is_of_its_model(model: str) -> None:
    for kind in ("published", "paper"):
        options = checked(f"experiment={kind}/{model}")
        assert (options.model.name, options.model.width, options.preset) == (model, 512, "paper")
    common = checked(f"experiment=paper/{model}")
    own = model in ("pix2pix", "monodepth_fpn")
    assert common.trainer.max_epochs == (200 if own else 50)
    assert (common.data.batch_size, common.data.size) == (8, [320, 320])
    assert (common.optimizer.name, common.optimizer.lr, common.optimizer.weight_decay) == (
        "adamw",
        1e-4,
        1e-2,
    )
    assert common.data.augment.model_dump() == {"rotation": 1.0, "flip": 0.0, "crop": 1.0, "jitter": 0.0}


def test_a_recipe_can_be_made_small() -> None:
    options = checked("experiment=published/newcrfs", "preset=smoke", "trainer.max_epochs=2")
    assert (options.model.encoder, options.model.width) == ("swin_tiny_patch4_window7_224", 64)
    assert (options.optimizer.name, options.optimizer.lr, options.data.size) == ("adam", 2e-5, [64, 64])
    assert options.one_protocol[1].mirror == "ramp"


def test_the_other_entry_points_compose() -> None:
    check_options(EvaluateOptions, composed("evaluate", "checkpoint=x.ckpt"))
    other = check_options(EvaluateOptions, composed("evaluate", "checkpoint=x.ckpt", "data=phantom"))
    assert other.data is not None
    assert other.data.name == "phantom"
    assert check_options(PrepareOptions, composed("prepare")).data.name == "phantom"
    assert check_options(PrepareOptions, composed("prepare", "phantom=smoke")).phantom.size == [135, 169]


@pytest.mark.parametrize(
    ("model", "terms"),
    [
        ("bts", ["depth"]),
        ("bts_cbam", ["depth"]),
        ("bts_cbam_mtl", ["depth", "normals"]),
        ("col3d_mtl", ["depth", "normals", "consistency"]),
        ("newcrfs", ["depth"]),
        ("monodepth_fpn", ["depth", "gradients", "directions"]),
        ("pix2pix", ["depth"]),
    ],
)
def test_a_model_brings_its_loss(model: str, terms: list[str]) -> None:
    assert [*checked(f"model={model}").loss.terms] == terms


def test_a_loss_on_the_command_line_wins_wherever_it_stands() -> None:
    assert [*checked("model=col3d_mtl", "loss=mtl").loss.terms] == ["depth", "normals"]
    assert [*checked("loss=mtl", "model=col3d_mtl").loss.terms] == ["depth", "normals"]
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


@pytest.mark.parametrize(
    ("overrides", "about", "named"),
    [
        (
            ["loss.lambdas=[0.5,0.3]"],
            "loss.lambdas",
            ["3 number(s)", "depth, normals, consistency", "[0.5, 0.3]"],
        ),
        (["model=bts", "loss.lambdas=[1,1,1]"], "loss.lambdas", ["expected 1", "model=bts"]),
        (
            ["model=bts", "loss=mtl_xtc"],
            "loss",
            ["normals and consistency", "model.normals=unc"],
        ),
        (["model.normals=none"], "model.normals", ["col3d_mtl", "bts_cbam"]),
        (["loss=silog"], "loss", ["model=col3d_mtl", "model=bts_cbam"]),
        (["model=bts", "model.normals=unc"], "loss", ["model=bts", "model.normals=none"]),
        (["model=pix2pix", "task.discriminator_width=9"], "task.discriminator_width", ["of 8", "got 9"]),
        (["model=bts", "model.normal_frame=ray"], "model.normal_frame", ["ray ", "model.normals is none"]),
        (["model.freeze=[bn]"], "model.freeze.0", ["'bn'", "batch_norm"]),
        (["optimizer.name=sgdd"], "optimizer.name", ["'sgd'", "'sgdd'"]),
        (["optimizer.lr=x"], "optimizer.lr", ["number", "'x'"]),
        (["+scheduler.powr=1"], "scheduler.powr", ["'scheduler.power'"]),
        (["++loss.terms.depth.from_epoch=-1"], "loss.terms.depth.from_epoch", ["equal to 0", "-1"]),
        (["++loss.terms.depth.term=berhuu"], "loss.terms", ["'berhuu'", "silog"]),
        (["++loss.terms.depth.tem=silog"], "loss.terms.depth.tem", ["no such option"]),
        (["protocol=native"], "protocol", ["network's resolution", "got native"]),
        (["protocol=[standard,published]"], "protocol", ["one protocol", "standard, published"]),
        (["task=adversarial", "trainer.accumulate=2"], "trainer.accumulate", ["task=adversarial", "got 2"]),
        (
            ["task=adversarial", "trainer.precision=16-mixed", "trainer.gradient_clip=1.0"],
            "trainer.gradient_clip",
            ["task=adversarial", "bf16-mixed"],
        ),
        (["loss.lambdas=[0,0,0]"], "loss.lambdas", ["above 0", "[0.0, 0.0, 0.0]"]),
        (["loss.lambdas=[0.5,-0.3,0.2]"], "loss.lambdas.1", ["equal to 0", "-0.3"]),
        (["loss.lambdas=[a,0.3,0.2]"], "loss.lambdas.0", ["number", "'a'"]),
        (["loss.lambdas=[.nan,0.3,0.2]"], "loss.lambdas.0", ["nan"]),
        (["+loss.lamdbas=[1,1,1]"], "loss.lamdbas", ["'loss.lambdas'"]),
        (["+trainer.max_epoch=3"], "trainer.max_epoch", ["'trainer.max_epochs'"]),
        (["+sed=3"], "sed", ["'seed'"]),
        (["model.width=eight"], "model.width", ["integer", "'eight'"]),
        (["model.width=8.5"], "model.width", ["integer", "8.5"]),
        (["model.width=100"], "model.width", ["multiple of 64", "100"]),
        (["data.size=[320]"], "data.size", ["2 items", "[320]"]),
        (["data.size=[320,8]"], "data.size.1", ["64", "got 8"]),
        (["data.normals=none"], "data.normals", ["the loss", "stored or derived"]),
        (["trainer.precision=half"], "trainer.precision", ["'half'", "bf16-mixed"]),
        (["seed=-1"], "seed", ["-1"]),
        (
            ["loss.terms.consistency.geometry=fisheye"],
            "loss.terms.consistency.geometry",
            ["rays", "'fisheye'"],
        ),
        (
            ["data/split=custom", "data.split.train=[a]", "data.split.val=[]", "data.split.test=[b]"],
            "data.split.val",
            ["needed"],
        ),
    ],
)
def test_each_mistake_is_one_line(overrides: list[str], about: str, named: list[str]) -> None:
    with refused(UserError, about, *named) as error:
        checked(*overrides)
    assert "\n" not in str(error.value)


def test_every_mistake_gets_its_own_line() -> None:
    with refused(UserError, "seed", "\nmodel.width: ") as error:
        checked("seed=-1", "model.width=eight")
    assert len(str(error.value).splitlines()) == 2


READS = ("LOAD_ATTR", "LOAD_METHOD", "LOAD_CONST")


def code_of(module: str) -> CodeType:
    spec: Any = find_spec(module)
    code: CodeType = spec.loader.get_code(module)
    return code


def read_in(code: CodeType) -> set[str]:
    """Attributes and text that functions read; what a class declares is none of it."""
    reads = get_instructions(code) if code.co_flags & CO_OPTIMIZED else ()
    inner = (read_in(part) for part in code.co_consts if isinstance(part, CodeType))
    return {str(read.argval) for read in reads if read.opname in READS}.union(*inner)


def test_no_option_is_without_effect() -> None:
    """Every declared option is read somewhere in the package beside its declaration."""
    modules = [module.name for module in walk_packages(col3d.__path__, "col3d.")]
    others = [name for name in modules if not name.endswith((".options", "__main__"))]
    read = set[str]().union(*(read_in(code_of(name)) for name in others))
    parts = [part for part in code_of(TrainOptions.__module__).co_consts if isinstance(part, CodeType)]
    read |= read_in(next(part for part in parts if part.co_name == TrainOptions.__name__))

    def names(options: Any) -> list[str]:
        kinds = [k for f in options.model_fields.values() for k in (f.annotation, *get_args(f.annotation))]
        inner = [kind for kind in kinds if hasattr(kind, "model_fields")]
        return [*options.model_fields, *(name for nested in inner for name in names(nested))]

    spread_whole = {
        *names(AugmentOptions),
        *names(LayoutOptions),
        *names(ModelOptions),
        *names(LossOptions),
        *names(OptimizerOptions),
        *names(SchedulerOptions),
    }  # handed on as they are
    assert set(names(TrainOptions)) - spread_whole - {"preset"} - read == set()


def test_an_objective_is_one_that_the_model_measures() -> None:
    assert checked("objective=[val/abs_rel,val/angle_mean]").objective == ["val/abs_rel", "val/angle_mean"]
    with refused(UserError, "objective", "val/angle_mean ", "model=bts", "val/abs_rel"):
        checked("model=bts", "objective=[val/angle_mean]")


@pytest.mark.parametrize(
    ("randomise", "ending"),
    [
        ("false", "_0"),
        ("true", "_0_randomised"),
        ("[sensor,light,tissue,anatomy]", "_0_randomised"),
        ("[tissue,light]", "_0_light_tissue"),
    ],
)
def test_a_phantom_is_called_after_what_it_draws(randomise: str, ending: str) -> None:
    assert checked("data=phantom", f"data.randomise={randomise}").data.root.endswith(ending)


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (("data.randomise=[colour]",), ("'anatomy', 'tissue', 'light' or 'sensor'", "'colour'")),
        (("data=c3vd", "data.root=x", "+data.randomise=true"), ("no such option",)),
    ],
)
def test_what_cannot_be_drawn_is_refused(overrides: tuple[str, ...], named: tuple[str, ...]) -> None:
    with refused(UserError, "data.randomise", *named):
        checked(*overrides)


def test_colons_are_named_by_their_numbers() -> None:
    found = checked("experiment=sim2real", "data.split.train=${colons:0,1,22,22}").data.split.train
    assert found == ["cecum_t1_a_s0", "cecum_t1_b_s0", "cecum_t1_a_s1"]


def test_what_shares_nothing_is_said_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    Scored.after(checked("experiment=sim2real").data, "test").print_audit()
    assert capsys.readouterr().out.splitlines()[1:] == ["  each of its 22 videos: nothing"]
    Scored.after(checked("experiment=sim2real", "data.split.test=${colons:0,1}").data, "test").print_audit()
    assert capsys.readouterr().out.splitlines()[2] == "  cecum_t1_b_s0: the video itself (cecum_t1_b_s0)"


@pytest.mark.parametrize("bounds", ["3", "1,2,3", "5,4", "-1,2", "a,2", "1.5,2"])
def test_what_names_no_colons_is_refused(bounds: str) -> None:
    with refused(InterpolationResolutionError, None, f"colons:{bounds}}}"):
        checked("experiment=sim2real", f"data.split.train=${{colons:{bounds}}}")

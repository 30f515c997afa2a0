"""More epochs for a run, and weights to begin from."""

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from cut_runs import QUICK, PowerCutError, assert_the_same, cut_in, result
from refusals import refused
from tiny_run import SMALL

from col3d.errors import UserError
from col3d.inference.predictor import load_predictor
from col3d.inference.trained_network import located
from col3d.layers.encoder import Encoder
from col3d.models import create
from col3d.registry.refusals import check_options
from col3d.training.build import build_task
from col3d.training.initial_weights import begin_from
from col3d.training.options import InitOptions, TrainOptions
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
STEADY = (*QUICK, "scheduler=constant")


@pytest.mark.parametrize("before", ["finished", "cut off"])
def test_a_longer_run_ends_as_if_it_had_been_asked_for_at_once(
    before: str,
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    train(tiny(*STEADY, "trainer.max_epochs=3", f"output_dir={tmp_path / 'whole'}"))
    if before == "finished":
        train(tiny(*STEADY, "trainer.max_epochs=1"))
    else:
        with monkeypatch.context() as patched:
            cut_in(patched, 1)
            with pytest.raises(PowerCutError):
                train(tiny(*STEADY, "trainer.max_epochs=2"))
    capsys.readouterr()
    train(tiny(*STEADY, "trainer.max_epochs=3"))
    said = capsys.readouterr().out
    assert "for 3 epochs instead of" in said
    assert "epoch 1/3" not in said
    assert_the_same(tmp_path / "run", tmp_path / "whole")
    assert result(tmp_path / "run")["epochs"] == 3


def test_a_longer_run_that_is_cut_off_goes_on(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    train(tiny(*STEADY, "trainer.max_epochs=3", f"output_dir={tmp_path / 'whole'}"))
    train(tiny(*STEADY, "trainer.max_epochs=1"))
    content = result(run)
    del content["epochs"]  # as runs of before have it
    (run / "result.json").write_text(json.dumps(content))
    with monkeypatch.context() as patched:
        cut_in(patched, 1)
        with pytest.raises(PowerCutError):
            train(tiny(*STEADY, "trainer.max_epochs=3"))
    assert result(run)["hash"] == content["hash"]
    capsys.readouterr()
    train(tiny(*STEADY, "trainer.max_epochs=1"))
    assert "finished before" in capsys.readouterr().out
    train(tiny(*STEADY, "trainer.max_epochs=3"))
    assert "finished before" not in capsys.readouterr().out
    assert_the_same(run, tmp_path / "whole")


def test_a_schedule_is_said_to_be_another(tiny: Compose, capsys: pytest.CaptureFixture[str]) -> None:
    train(tiny(*QUICK, "trainer.max_epochs=1"))
    train(tiny(*QUICK, "trainer.max_epochs=2"))
    assert "the learning rate goes on where its schedule over 2 epochs would be" in capsys.readouterr().out


@pytest.mark.parametrize("other", ["trainer.max_epochs=1", "seed=3 trainer.max_epochs=3"])
def test_fewer_epochs_or_another_run_are_refused(tiny: Compose, tmp_path: Path, other: str) -> None:
    train(tiny(*STEADY, "trainer.max_epochs=2"))
    changed = [argument.partition("=")[0] for argument in other.split()]
    with refused(UserError, None, tmp_path / "run", "another ", *changed):
        train(tiny(*STEADY, *other.split()))


def test_an_option_that_is_new_and_null_leaves_finished_runs_finished(
    tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    train(tiny(*QUICK))
    content = yaml.safe_load((run / "config.yaml").read_text())
    del content["init"]
    (run / "config.yaml").write_text(yaml.safe_dump(content))
    (run / "result.json").write_text(
        json.dumps({**result(run), "hash": "of a version that hashed otherwise"})
    )
    before = (run / "checkpoints" / "best.ckpt").read_bytes()
    capsys.readouterr()
    train(tiny(*QUICK))
    assert "finished before" in capsys.readouterr().out
    assert (run / "checkpoints" / "best.ckpt").read_bytes() == before


def network_of(path: Path) -> dict[str, torch.Tensor]:
    state = torch.load(path, weights_only=True)["state_dict"]
    return {
        name.removeprefix("network."): values for name, values in state.items() if name.startswith("network.")
    }


@pytest.fixture
def best(tiny: Compose, tmp_path: Path) -> Path:
    train(tiny(*QUICK))
    return tmp_path / "run" / "checkpoints" / "best.ckpt"


def options_of(given: dict[str, Any]) -> TrainOptions:
    return check_options(TrainOptions, given)


def test_all_weights_of_the_same_network_are_taken(best: Path, tiny: Compose) -> None:
    options = options_of(tiny(*QUICK, f"init.checkpoint={best}", "seed=9", "optimizer.lr=0.00001"))
    network, said = build_task(options).network, []
    begin_from(network, options.init, said.append)
    for name, values in network_of(best).items():
        assert torch.equal(network.state_dict()[name], values)
    assert len(said) == 1
    assert f"begins from {len(network.state_dict())} of {len(network.state_dict())} tensors" in said[0]


def test_all_of_what_ships_is_taken() -> None:
    network, said = load_predictor(Path("shipped")).network, list[str]()
    begin_from(network, InitOptions(checkpoint="shipped"), said.append)
    count = len(network.state_dict())
    assert said == [f"begins from {count} of {count} tensors of shipped"]


def test_a_network_that_shares_nothing_is_refused() -> None:
    with refused(UserError, "init.checkpoint", "none of the ", " shipped "):
        begin_from(torch.nn.Linear(3, 3), InitOptions(checkpoint="shipped"))


def test_what_is_not_taken_is_listed(best: Path) -> None:
    other = create("bts", encoder="lcnet_035", width=64, normals="unc", pretrained=None)
    before = {name: values.clone() for name, values in other.state_dict().items()}
    said: list[str] = []
    begin_from(other, InitOptions(checkpoint=str(best)), said.append)
    given, after = network_of(best), other.state_dict()
    taken = [name for name in after if name in given and given[name].shape == after[name].shape]
    assert 0 < len(taken) < len(after)
    for name in after:
        assert torch.equal(after[name], given[name] if name in taken else before[name])
    assert f"begins from {len(taken)} of {len(after)} tensors" in said[0]
    assert said[-1] == "  what was not taken is as it was initialised"


def test_a_training_begins_there(
    best: Path, tiny: Compose, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tiny(
        *QUICK, f"init.checkpoint={best}", f"output_dir={tmp_path / 'tuned'}", "optimizer.lr=1e-12", "seed=5"
    )
    train(given)
    assert "begins from" in capsys.readouterr().out
    tuned = network_of(tmp_path / "tuned" / "checkpoints" / "best.ckpt")
    for name, values in network_of(best).items():
        if not name.endswith(("running_mean", "running_var", "num_batches_tracked")):
            torch.testing.assert_close(tuned[name], values, rtol=0, atol=1e-6)
    starts = json.loads((tmp_path / "tuned" / "starts.json").read_text())["starts"]
    assert f"init.checkpoint {best}" in starts[0]["data"]


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        (("init.checkpoint=nowhere.ckpt",), "init.checkpoint", ("no such file: nowhere.ckpt",)),
        (("init.published=bts",), "init.published", ("init.checkpoint=PATH",)),
        (("init.checkpoint={other}",), "init.checkpoint", ("{other} ", "train.py")),
        (("init.checkpoint={nan}",), "init.checkpoint", ("{nan}: ", "finite")),
        (("init.checkpoint={best}", "model.encoder=mobilenetv3_small_050"), "", ()),
        (("model.pretrained={best}",), "model.pretrained", ("{best}", "init.checkpoint")),
    ],
)
def test_weights_that_do_not_serve_are_refused(
    best: Path,
    tiny: Compose,
    tmp_path: Path,
    options: tuple[str, ...],
    about: str,
    named: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
) -> None:
    content = torch.load(best, weights_only=True)
    torch.save({"state_dict": {"a": torch.ones(2)}}, tmp_path / "other.pt")
    content["state_dict"] = {name: values * torch.nan for name, values in content["state_dict"].items()}
    torch.save(content, tmp_path / "nan.pt")
    places = {"best": best, "other": tmp_path / "other.pt", "nan": tmp_path / "nan.pt"}
    given = tiny("model=bts", SMALL, f"output_dir={tmp_path / 'x'}", *(o.format(**places) for o in options))
    if not about:
        train(given)
        assert "of another shape there" in capsys.readouterr().out
        return
    with refused(UserError, about, *(part.format(**places) for part in named)):
        train(given)
    assert not (tmp_path / "x" / "checkpoints").exists()


def test_a_run_that_goes_on_does_not_begin_again(
    best: Path,
    tiny: Compose,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = best.rename(tmp_path / "source.ckpt")
    given = (*STEADY, "trainer.max_epochs=2", f"init.checkpoint={source}")
    train(tiny(*given, f"output_dir={tmp_path / 'whole'}"))
    with monkeypatch.context() as patched:
        cut_in(patched, 1)
        with pytest.raises(PowerCutError):
            train(tiny(*given, f"output_dir={tmp_path / 'cut'}"))
    source.unlink()
    capsys.readouterr()
    train(tiny(*given, f"output_dir={tmp_path / 'cut'}"))
    said = capsys.readouterr().out
    assert "goes on from" in said
    assert "begins from" not in said
    assert_the_same(tmp_path / "cut", tmp_path / "whole")


@pytest.mark.parametrize("option", ["init.checkpoint", "model.pretrained"])
@pytest.mark.parametrize("name", ["checkpoints/best.ckpt", "checkpoints/last.ckpt", "linked.ckpt"])
def test_a_run_does_not_begin_from_what_it_replaces(
    option: str, name: str, best: Path, tiny: Compose, tmp_path: Path
) -> None:
    run = best.parents[1]
    (run / "linked.ckpt").symlink_to(best)
    content = best.read_bytes()
    given = f"{option}={run / name}"
    with refused(UserError, None, run, "another ", option):
        train(tiny(*QUICK, given))
    with refused(UserError, option, run / name, f"this very run, {run}"):
        train(tiny(*QUICK, given, "overwrite=true"))
    assert best.read_bytes() == content


def with_weight(values: Any) -> Callable[[dict[Any, Any], str], None]:
    return lambda state, name: state.update({name: values(state[name].float())})


NO_WEIGHTS: dict[str, tuple[Callable[[dict[Any, Any], str], None], tuple[str, ...]]] = {
    "text": (with_weight(lambda w: "x"), ("a str",)),
    "nothing": (with_weight(lambda w: None), ("a NoneType",)),
    "array": (with_weight(lambda w: w.numpy()), ("a ndarray",)),
    "sparse": (with_weight(lambda w: w.to_sparse()), ("dense", "torch.sparse_coo")),
    "complex": (with_weight(lambda w: w * 1j), ("real numbers", "complex64")),
    "elsewhere": (with_weight(lambda w: w.to("meta")), ("dense", "torch.strided")),
    "whole numbers": (with_weight(lambda w: w.int()), ("whole numbers", "torch.int32")),
    "truths": (with_weight(lambda w: w > 0), ("whole numbers", "torch.bool")),
    "beyond float32": (with_weight(lambda w: w.double() + 1e300), ("not finite",)),
}


@pytest.mark.filterwarnings("ignore:Validating sparse tensor")
@pytest.mark.parametrize("what", NO_WEIGHTS)
@pytest.mark.parametrize("reader", ["init.checkpoint", "checkpoint", "model.pretrained"])
def test_what_is_no_weight_is_refused_by_its_name(reader: str, what: str, tmp_path: Path) -> None:
    spoil, named = NO_WEIGHTS[what]
    path = tmp_path / "spoiled.ckpt"
    if reader == "model.pretrained":
        state: dict[Any, Any] = dict(Encoder(SMALL.partition("=")[2]).net.state_dict())
        spoil(state, "conv_stem.weight")
        torch.save(state, path)
        if what in ("text", "nothing"):
            named = ("1 weights", "'conv_stem.weight'")
        if what == "array":
            named = ("read as weights",)
        with refused(ValueError, "model.pretrained", f"'{path}'", *named):
            Encoder(SMALL.partition("=")[2], str(path))
        return
    content = torch.load(located(Path("shipped")), weights_only=True)
    spoil(content["state_dict"], "network.encoder.net.conv_stem.weight")
    torch.save(content, path)
    network = load_predictor(Path("shipped")).network
    begin = functools.partial(begin_from, network, InitOptions(checkpoint=str(path)))
    run: Callable[[], Any] = functools.partial(load_predictor, path) if reader == "checkpoint" else begin
    with refused(UserError, reader, f"{path}: ", "conv_stem.weight ", *named):
        run()


@pytest.mark.parametrize("published", [None, "bts"])
@pytest.mark.parametrize(
    ("kept", "said"), [(0, "empty"), (4, "cut off"), (100_000, "cut off"), (-1, "cut off")]
)
def test_weights_that_are_cut_off_are_called_so(kept: int, said: str, published: Any, tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    path.write_bytes(located(Path("shipped")).read_bytes()[:kept])
    with refused(UserError, "init.checkpoint", path, said):
        begin_from(torch.nn.Linear(1, 1), InitOptions(checkpoint=str(path), published=published))
    with refused(UserError, "checkpoint", path, said):
        load_predictor(path)

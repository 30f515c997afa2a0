"""Weights that are not as they were saved, or are no numbers, are used by no command."""

import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from parity import needs_parity, published_state
from refusals import refused
from tiny_run import SMALL, composed
from torch import Tensor

from col3d import weights
from col3d.batch import Prediction
from col3d.errors import OptionError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.inference import trained_network as learning
from col3d.inference.demo.answer import answer
from col3d.inference.export.export import export
from col3d.inference.fusion.fuse import fuse
from col3d.inference.predict import predict
from col3d.inference.predictor import load_predictor
from col3d.inference.trained_network import SHIPPED, published_network
from col3d.io.predictions import PredictionWriter
from col3d.layers.encoder import Encoder
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]
BITS = 60
TRACED = 3
"""The reader that follows a network's code, and cannot follow what a test puts in its place."""
WHOLE = Path(weights.__file__).with_name("shipped.ckpt")


def readers(checkpoint: Path, root: Path, out: Path) -> Iterator[Callable[[], Any]]:
    """Every command that reads a checkpoint."""
    given = [f"checkpoint={checkpoint}", "accelerator=cpu"]
    image, video = root / "desc_t4_a" / "0000_color.png", root / "desc_t4_a"
    yield lambda: predict(composed("predict", *given, f"input={image}", f"output={out / 'predicted'}"))
    yield lambda: evaluate(composed("evaluate", *given, "panels=0", f"output_dir={out / 'scored'}"))
    yield lambda: export(composed("export", given[0], f"output={out / 'exported.ckpt'}"))
    yield lambda: export(composed("export", given[0], f"output={out / 'exported.pt2'}"))
    yield lambda: fuse(composed("fuse", *given, f"video={video}", f"output={out / 'fused'}"))
    yield lambda: answer(load_predictor(checkpoint), np.zeros((64, 80, 3), np.uint8), None)


def flipped(content: bytes, place: int, bit: int) -> bytes:
    changed = bytearray(content)
    changed[place] ^= 1 << bit
    return bytes(changed)


def spoiled(checkpoint: Path, path: Path, value: float) -> Path:
    """A whole file with one weight that is no number."""
    content = torch.load(checkpoint, weights_only=True)
    name = next(name for name in content["state_dict"] if name.startswith("network.") and "weight" in name)
    content["state_dict"][name][(0,) * content["state_dict"][name].ndim] = value
    torch.save(content, path)
    return path


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_weights_that_are_no_numbers_are_used_by_nobody(
    value: float, tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    path = spoiled(tiny_checkpoint, tmp_path / "some.ckpt", value)
    for run in readers(path, phantom_root, tmp_path / "out"):
        with refused(UserError, "checkpoint", f"{path}: network.", "finite") as error:
            run()
        assert "\n" not in str(error.value)
    assert not [found for found in (tmp_path / "out").rglob("*") if found.is_file()]


def test_one_bit_in_the_weights_is_noticed_by_everybody(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    content = tiny_checkpoint.read_bytes()
    path = tmp_path / "some.ckpt"
    state = torch.load(tiny_checkpoint, weights_only=True)["state_dict"]
    largest = max((v for n, v in state.items() if n.startswith("network.")), key=torch.numel)
    path.write_bytes(flipped(content, content.index(bytes(largest.untyped_storage())) + 100, 3))
    for run in readers(path, phantom_root, tmp_path / "out"):
        with refused(UserError, "checkpoint", f"{path} is damaged"):
            run()


def test_any_bit_of_a_checkpoint_is_damage_or_nothing(tiny_checkpoint: Path, tmp_path: Path) -> None:
    content, random = tiny_checkpoint.read_bytes(), np.random.default_rng(0)
    path, whole = tmp_path / "some.ckpt", load_predictor(tiny_checkpoint).network.state_dict()
    noticed = 0
    for place in random.integers(len(content), size=BITS):
        path.write_bytes(flipped(content, int(place), int(place) % 8))
        try:
            found = load_predictor(path).network.state_dict()
        except UserError as error:
            assert "\n" not in str(error)  # noqa: PT017 - most of them, and never another
            noticed += 1
            continue
        assert all(torch.equal(found[name], values) for name, values in whole.items())
    assert noticed > 0.9 * BITS


def test_any_bit_of_the_shipped_file_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content, random = WHOLE.read_bytes(), np.random.default_rng(1)
    path = tmp_path / "shipped.ckpt"
    monkeypatch.setattr(learning, "located", lambda checkpoint: path)
    path.write_bytes(content)
    assert load_predictor(Path(SHIPPED)).name == load_predictor(WHOLE).name
    for place in random.integers(len(content), size=BITS):
        path.write_bytes(flipped(content, int(place), int(place) % 8))
        with refused(UserError, None, f"{path} is damaged"):
            load_predictor(Path(SHIPPED))


@needs_parity
@pytest.mark.parametrize("zipped", [True, False])
def test_published_weights_that_are_no_numbers(zipped: bool, tmp_path: Path) -> None:
    state = dict(published_state("col3d_mtl"))
    name = next(name for name, values in state.items() if values.is_floating_point())
    state[name] = state[name].clone()
    state[name].view(-1)[-1] = math.nan
    torch.save({"model": state}, tmp_path / "weights", _use_new_zipfile_serialization=zipped)
    with refused(UserError, None, name, "finite"):
        published_network(tmp_path / "weights", "col3d_mtl")


def test_weights_to_start_from(tmp_path: Path) -> None:
    whole = Encoder("lcnet_035").net.state_dict()
    path = tmp_path / "encoder.pt"
    torch.save(whole, path)
    Encoder("lcnet_035", str(path))
    content = path.read_bytes()
    name, largest = max(whole.items(), key=lambda pair: pair[1].numel())
    path.write_bytes(flipped(content, content.index(bytes(largest.untyped_storage())) + 100, 3))
    with refused(OptionError, "model.pretrained", f"{path} is damaged"):
        Encoder("lcnet_035", str(path))
    torch.save({**whole, name: torch.full_like(largest, math.nan)}, path)
    with refused(OptionError, "model.pretrained", path, name, "finite"):
        Encoder("lcnet_035", str(path))


def test_depth_that_is_no_number_is_written_by_nobody(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As from weights that are finite, and too large."""
    network = load_predictor(tiny_checkpoint)
    called = type(network.network).forward

    def overflowing(self: Any, image: Tensor, rays: Tensor | None = None) -> Any:
        found = called(self, image, rays)
        return {**found, "depth": torch.full_like(found["depth"], math.nan)}

    with monkeypatch.context() as patched:
        patched.setattr(type(network.network), "forward", overflowing)
        found = list(readers(tiny_checkpoint, phantom_root, tmp_path / "out"))
        for run in (*found[:TRACED], *found[TRACED + 1 :]):
            with refused(UserError, None) as error:
                run()
            assert "finite" in str(error.value) or "nan" in str(error.value)
        with refused(UserError, None, "depth of desc_t4_a:0 ", "finite"):
            evaluate(composed("evaluate", f"checkpoint={tiny_checkpoint}", "accelerator=cpu", "split=test"))
    assert not list((tmp_path / "out").rglob("*.tiff"))
    with refused(UserError, None, "normals of a, frame 3,", "finite"):
        PredictionWriter(tmp_path / "p", {"max_depth": 1.0}).add(
            "a", 3, np.ones((2, 2)), np.full((2, 2, 3), math.nan)
        )


def test_a_test_that_gives_no_numbers_finishes_no_run(
    tiny: Compose, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def overflows(prediction: Prediction) -> Prediction:
        return {"depth": prediction["depth"] * math.inf}

    monkeypatch.setattr("col3d.evaluation.predict_frames.known_maps", overflows)
    with refused(UserError, None, "depth of desc_t4_a:0 ", "finite"):
        train(tiny("model=bts", SMALL, "callbacks.panels=0"))
    assert not (tmp_path / "run" / "result.json").exists()


def test_the_best_weights_of_another_run_are_noticed(
    tiny: Compose,
    phantom_root: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    quick = ("model=bts", SMALL, "callbacks.panels=0", "trainer.max_epochs=2")
    for number, name in enumerate(("run", "other", "cut")):
        train(tiny(*quick, f"seed={number}", f"output_dir={tmp_path / name}"))
    train(tiny(*quick, f"output_dir={tmp_path / 'twin'}"))
    best = tmp_path / "run" / "checkpoints" / "best.ckpt"
    own = best.read_bytes()
    for name in ("other", "twin"):
        shutil.copy(tmp_path / name / "checkpoints" / "best.ckpt", best)
        for run in readers(best, phantom_root, tmp_path / "out"):
            with refused(UserError, "checkpoint", f"{best} is of another run"):
                run()
        capsys.readouterr()
        train(tiny(*quick))
        assert f"note: {best} is of another run" in capsys.readouterr().out
        (tmp_path / "run" / "result.json").unlink()
        with refused(UserError, None, f"{best} is of another run"):
            train(tiny(*quick))
        best.write_bytes(own)
        train(tiny(*quick))
        assert "another run" not in capsys.readouterr().out
    shutil.copy(best, tmp_path / "elsewhere.ckpt")
    assert load_predictor(tmp_path / "elsewhere.ckpt").name == "bts"

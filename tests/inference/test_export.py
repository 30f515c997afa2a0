"""Exported files: what they say, of themselves and of images, and what is refused."""

import json
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from programs import call
from refusals import refusal, refused
from tiny_run import composed

from col3d.errors import UserError
from col3d.inference.export.export import export
from col3d.inference.export.exported import is_exported
from col3d.inference.export.half_precision import HalfNetwork
from col3d.inference.export.parity import compare
from col3d.inference.export.traced import Fixed
from col3d.inference.predictor import load_predictor
from col3d.inference.trained_network import located

pytestmark = pytest.mark.end_to_end

PROJECT = Path(__file__).parents[2]
WITHOUT = (
    "import runpy, sys\n"
    "for name in ('torch', 'col3d'): sys.modules[name] = None\n"
    "sys.argv = sys.argv[1:]\n"
    "runpy.run_path(sys.argv[0], run_name='__main__')"
)


def exported(checkpoint: Path, path: Path) -> None:
    """Export by the command, which says what it checked."""
    answer = call("export", f"checkpoint={checkpoint}", f"output={path.name}", cwd=path.parent)
    assert (answer.returncode, answer.stderr) == (0, "")
    said = answer.stdout.splitlines()
    assert len(said) == 5
    assert f"wrote {path.name}, " in said[1]
    assert "image -> depth, normals" in said[1]
    assert "1 x 33 x 130, 3 x 75 x 101, 2 x 224 x 97, 1 x 64 x 80" in said[2]
    assert [found.name for found in path.parent.iterdir()] == [path.name]
    assert is_exported(path)


def test_an_onnx_file(tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path) -> None:
    """One test, for making the file takes half a minute."""
    path = tmp_path / "model.onnx"
    exported(tiny_checkpoint, path)
    takes_any_size(path, tiny_checkpoint)
    speaks_for_itself(path)
    the_example_needs_no_torch(path, phantom_root)


def takes_any_size(path: Path, checkpoint: Path) -> None:
    import onnxruntime

    session = onnxruntime.InferenceSession(path)
    assert [tuple(value.shape) for value in (*session.get_inputs(), *session.get_outputs())] == [
        ("batch", 3, "height", "width"),
        ("batch", 1, "height", "width"),
        ("batch", 3, "height", "width"),
    ]
    network = load_predictor(checkpoint).network
    for shape in ((1, 3, 64, 80), (2, 3, 50, 131), (1, 3, 1, 1)):
        image = torch.rand(shape)
        depth, normals = session.run(["depth", "normals"], {"image": image.numpy()})
        with torch.no_grad():
            expected = network(image)
        np.testing.assert_allclose(depth, expected["depth"], atol=1e-3)
        np.testing.assert_allclose(normals, expected["normals"], atol=1e-4)


def speaks_for_itself(path: Path) -> None:
    import onnx

    facts = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert (facts["model"], json.loads(facts["max_depth"])) == ("col3d_mtl", 100.0)
    assert json.loads(facts["trained_size"]) == [64, 80]
    assert json.loads(facts["trained_on"]) == ["phantom"]
    assert [lens["model"] for lens in json.loads(facts["lenses"])] == ["omnidirectional"]
    assert "x right, y down, z forward" in facts["conventions"]
    assert "RGB in [0, 1]" in json.loads(facts["inputs"])["image"]
    assert str(PROJECT).encode() not in path.read_bytes()


def the_example_needs_no_torch(path: Path, phantom_root: Path) -> None:
    image, depth = next((phantom_root / "desc_t4_a").glob("*_color.png")), path.with_name("depth.png")
    arguments = [str(PROJECT / "examples/onnx_depth.py"), str(path), str(image), str(depth)]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    codes = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
    assert codes is not None
    assert (codes.dtype, codes.shape) == (np.uint16, (64, 80))
    assert codes.min() > 0


def test_a_program_file(tiny_checkpoint: Path, tmp_path: Path) -> None:
    path, facts = tmp_path / "model.pt2", {"col3d.json": ""}
    exported(tiny_checkpoint, path)
    program = torch.export.load(path, extra_files=facts).module(check_guards=False)
    image = torch.rand(1, 3, 90, 70)
    with torch.no_grad():
        found, expected = program(image), load_predictor(tiny_checkpoint).network(image)
    torch.testing.assert_close(found["depth"], expected["depth"], atol=1e-3, rtol=0)
    torch.testing.assert_close(found["normals"], expected["normals"], atol=1e-4, rtol=0)
    assert json.loads(facts["col3d.json"])["trained_size"] == [64, 80]
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            assert str(PROJECT).encode() not in archive.read(name), name
            assert sys.prefix.encode() not in archive.read(name), name


def test_an_onnx_file_of_one_size_in_half_precision(tiny_checkpoint: Path, tmp_path: Path) -> None:
    import onnx
    import onnxruntime

    options = ("opset=18", "size=[96,128]", "batch=2", "half=true")
    answer = call("export", f"checkpoint={tiny_checkpoint}", "output=m.onnx", *options, cwd=tmp_path)
    assert (answer.returncode, answer.stderr) == (0, "")
    said = answer.stdout.splitlines()
    assert said[2] == "batches of 2, images of 96 x 128; checked at 2 x 96 x 128"
    assert said[3].startswith("largest difference from PyTorch in single precision: depth ")
    assert "; PyTorch's own in half: depth " in said[3]
    model = onnx.load(tmp_path / "m.onnx")
    assert {entry.domain: entry.version for entry in model.opset_import}[""] == 18
    facts = {entry.key: entry.value for entry in model.metadata_props}
    assert (json.loads(facts["batch"]), json.loads(facts["size"])) == (2, [96, 128])
    weights = [value for value in model.graph.initializer if len(value.dims) == 4]
    assert len(weights) > 20
    assert {value.data_type for value in weights if value.dims[-1] > 1 or value.dims[0] > 1} == {
        onnx.TensorProto.FLOAT16
    }
    session = onnxruntime.InferenceSession(tmp_path / "m.onnx")
    values = (*session.get_inputs(), *session.get_outputs())
    assert [(tuple(value.shape), value.type) for value in values] == [
        ((2, 3, 96, 128), "tensor(float)"),
        ((2, 1, 96, 128), "tensor(float)"),
        ((2, 3, 96, 128), "tensor(float)"),
    ]
    image = torch.rand(2, 3, 96, 128, generator=torch.Generator().manual_seed(5))
    depth, _ = session.run(["depth", "normals"], {"image": image.numpy()})
    network = load_predictor(tiny_checkpoint).network
    with torch.no_grad():
        expected, rounded = network(image)["depth"], HalfNetwork(network)(image)["depth"]
    own = (rounded - expected).abs().max().item()
    assert 0 < own < 0.5
    assert 0 < np.abs(depth - expected.numpy()).max() <= 2 * own + 1e-3


def test_a_program_of_one_size(tiny_checkpoint: Path, tmp_path: Path) -> None:
    path = tmp_path / "m.pt2"
    export(composed("export", f"checkpoint={tiny_checkpoint}", f"output={path}", "size=[64,96]", "half=true"))
    facts = {"col3d.json": ""}
    program = torch.export.load(path, extra_files=facts).module(check_guards=False)
    assert (json.loads(facts["col3d.json"])["size"], json.loads(facts["col3d.json"])["batch"]) == (
        [64, 96],
        None,
    )
    for batch in (1, 3):
        with torch.no_grad():
            found = program(torch.rand(batch, 3, 64, 96))
        assert (found["depth"].shape, found["depth"].dtype) == ((batch, 1, 64, 96), torch.float32)


def test_what_half_precision_may_change(tiny_checkpoint: Path) -> None:
    """Twice what it changes in PyTorch itself on the same image, and no more."""
    subject = load_predictor(tiny_checkpoint)
    half = HalfNetwork(subject.network).eval()

    def off(factor: float) -> Callable[[Mapping[str, np.ndarray]], dict[str, np.ndarray]]:
        def run(inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            image = torch.from_numpy(inputs["image"])
            with torch.no_grad():
                exact, rounded = subject.network(image), half(image)
            return {name: (exact[name] + factor * (rounded[name] - exact[name])).numpy() for name in rounded}

        return run

    found = compare(subject, off(1.9), Fixed(1, (64, 80)), half)
    assert found.sizes == [(1, 64, 80)]
    assert found.differences["depth"] == pytest.approx(1.9 * found.rounding["depth"], rel=1e-2)
    with refused(UserError, "export", " of 1 x 64 x 80 "):
        compare(subject, off(2.5), Fixed(1, (64, 80)), half)


def test_weights_to_share_name_no_place(tmp_path: Path) -> None:
    content = torch.load(located(Path("shipped")), weights_only=True)
    secret = "/home/ann/secret"
    content["about"]["command"] = f"python train.py data.root={secret}/C3VD 'output_dir={secret}/my run'"
    options = content["hyper_parameters"]["options"]
    options["data"] |= {"root": f"{secret}/C3VD", "store": f"{secret}/store"}
    options["output_dir"] = f"{secret}/my run"
    torch.save(content, tmp_path / "best.ckpt")
    export(composed("export", f"checkpoint={tmp_path / 'best.ckpt'}", f"output={tmp_path / 'shared.ckpt'}"))
    written = (tmp_path / "shared.ckpt").read_bytes()
    for name in (b"/home", b"ann/", b"secret", str(tmp_path).encode()):
        assert name not in written
    about = torch.load(tmp_path / "shared.ckpt", weights_only=True)["about"]
    assert about["command"] == "python train.py data.root=C3VD 'output_dir=my run'"


def test_other_networks_are_open_in_their_sizes() -> None:
    command = [sys.executable, str(PROJECT / "tests" / "helpers" / "open_sizes.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=PROJECT)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 9


def test_a_file_that_differs_is_refused(tiny_checkpoint: Path) -> None:
    subject = load_predictor(tiny_checkpoint)

    def off(inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        with torch.no_grad():
            found = subject.network(torch.from_numpy(inputs["image"]))
        return {"depth": found["depth"].numpy() + 0.01, "normals": found["normals"].numpy()}

    with refused(UserError, "export", "depth of 1 x 33 x 130 ", 0.01, 0.001):
        compare(subject, off)


def test_what_was_refused_leaves_no_file(
    tiny_checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("col3d.inference.export.export.write_checked", broken)
    with pytest.raises(ZeroDivisionError):
        export(composed("export", f"checkpoint={tiny_checkpoint}", f"output={tmp_path / 'new' / 'm.onnx'}"))
    assert list((tmp_path / "new").iterdir()) == []


ENDINGS = ".onnx, .pt2 or .ckpt"


@pytest.mark.parametrize(
    ("arguments", "about", "named"),
    [
        (("output=m.tflite",), "output", (ENDINGS, "'m.tflite'")),
        (("output=.onnx",), "output", (ENDINGS, "'.onnx'")),
        (("output=folder/.ckpt",), "output", (ENDINGS, "'folder/.ckpt'")),
        (("output=m.ONNX",), "output", (ENDINGS, "'m.ONNX'")),
        (("output=''",), "output", ("got ''",)),
        (("output=there.onnx",), "output", ("there.onnx ", "overwrite=true")),
        (("output=folder.pt2", "overwrite=true"), "output", ("folder.pt2 ", "a folder")),
        (("output=m.onnx",), "checkpoint", ("no such file: none.ckpt",)),
        (("output=m.ckpt", "size=[64,64]"), "size", (".onnx and .pt2", ".ckpt")),
        (("output=m.ckpt", "batch=1"), "batch", (".onnx and .pt2",)),
        (("output=m.ckpt", "half=true"), "half", (".onnx and .pt2",)),
        (("output=m.pt2", "opset=18"), "opset", (".onnx", "output=m.pt2")),
        (("output=m.onnx", "opset=17"), "opset", ("equal to 18", 17)),
        (("output=m.onnx", "opset=26"), "opset", ("equal to 25", 26)),
        (("output=m.onnx", "opset=new"), "opset", ("integer", "'new'")),
        (("output=m.onnx", "batch=0"), "batch", ("equal to 1", 0)),
        (("output=m.onnx", "size=[256]"), "size", ("2 items", "[256]")),
        (("output=m.onnx", "size=[16,320]"), "size.0", ("equal to 64", 16)),
        (("output=m.onnx", "half=maybe"), "half", ("boolean", "'maybe'")),
        (("output=m.onnx", "max_depth=50"), "max_depth", ("published",)),
        (("output=m.onnx", "published=bts", "max_depth=0"), "max_depth", ("greater than 0", "got 0")),
    ],
)
def test_bad_input_is_refused(
    arguments: tuple[str, ...],
    about: str,
    named: tuple[object, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.onnx").touch()
    Path("folder.pt2").mkdir()
    with refused(UserError, about, *named):
        export(composed("export", "checkpoint=none.ckpt", *arguments))
    assert Path("there.onnx").stat().st_size == 0


@pytest.mark.parametrize(
    "error",
    [MemoryError("std::bad_alloc"), RuntimeError("[enforce fail] DefaultCPUAllocator: not enough memory")],
)
def test_memory_that_is_out_is_a_line(
    error: Exception, tiny_checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise error

    monkeypatch.setattr("col3d.inference.export.export.write_checked", full)
    given = (f"checkpoint={tiny_checkpoint}", f"output={tmp_path / 'm.pt2'}", "size=[20000,20000]")
    with refused(UserError, None, f"memory is out ({type(error).__name__})", "size=", "batch="):
        export(composed("export", *given))
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with refused(UserError, "export", "pip install -e '.[onnx]'"):
        export(composed("export", "checkpoint=none.ckpt", f"output={tmp_path / 'm.onnx'}"))


def test_the_command_ends_in_one_line(tmp_path: Path) -> None:
    answer = call("export", "checkpoint=none.ckpt", "output=/proc/nowhere/m.pt2", cwd=tmp_path)
    assert answer.returncode == 2
    assert refusal(answer.stderr).about == "checkpoint"
    assert "no such file: none.ckpt" in answer.stderr
    answer = call("export", "--help", cwd=tmp_path)
    assert answer.returncode == 0
    assert "col3d export checkpoint=" in answer.stdout

"""What is foreseen ends in one line that names the option or file: never in a traceback."""

import json
import multiprocessing.connection
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from programs import call
from refusals import refusal, refused
from tiny_run import composed
from torch.utils.data import DataLoader, Dataset

from col3d.errors import UserError
from col3d.inference.cameras import camera_at, lens_of
from col3d.inference.predictor import load_predictor
from col3d.inference.trained_network import located
from col3d.registry.refusals import check_options
from col3d.runs.checkpoints import read_checkpoint
from col3d.runs.known_failures import as_user_errors
from col3d.training.options import TrainOptions

pytestmark = pytest.mark.end_to_end

WRONG = ([], "x", 3, {"cameras": 3}, {"cameras": [3]}, {"cameras": ["x"]}, {"cameras": [{"model": []}]})
NUMBERS = '"size":[64,80],"fx":9,"fy":9,"cx":9,"cy":9'
PEER = """
import os, sys, torch
from col3d.runs.known_failures import as_user_errors
from col3d.errors import UserError
rank = int(sys.argv[1])
torch.distributed.init_process_group("gloo", init_method="file://" + sys.argv[2], rank=rank, world_size=2)
if rank == 1:
    os._exit(9)
try:
    with as_user_errors("smaller"):
        for _ in range(100):
            torch.distributed.all_reduce(torch.zeros(1))
except UserError as error:
    print(error)
os._exit(0)
"""


@pytest.mark.parametrize(
    "text",
    [
        '{"model":"pinhole","size":[64,80],"fx":1' + "0" * 400 + ',"fy":9,"cx":9,"cy":9}',
        '{"model":"pinhole",' + NUMBERS.replace("64", "1" + "0" * 5000) + "}",
        "[" * 100_000,
        '{"a":' * 100_000,
        '{"model":{}}',
        '{"model":"pinhole",' + NUMBERS.replace("[64,80]", "[[64],80]") + "}",
        '{"model":"pinhole",' + NUMBERS.replace("64", "NaN") + "}",
        '{"model":"omnidirectional","size_hw":[64,80],"centre":[1,1],"stretch":[[1]],"polynomial":3}',
        "\xff\xfe",
    ],
)
def test_a_file_that_is_no_camera(text: str, tmp_path: Path) -> None:
    path = tmp_path / "lens.json"
    path.write_bytes(text.encode("latin-1"))
    with refused(UserError, "camera", f"{path}: not a camera: "):
        camera_at(lens_of(str(path)), (64, 80))


def shipped() -> dict[str, Any]:
    content: dict[str, Any] = torch.load(located(Path("shipped")), weights_only=True)
    return content


@pytest.mark.parametrize("about", WRONG)
def test_what_weights_say_of_themselves(about: Any, tmp_path: Path) -> None:
    path = tmp_path / "weights.ckpt"
    torch.save(shipped() | {"about": about}, path)
    try:
        assert load_predictor(path).cameras == ()
    except UserError as error:
        assert error.about == "checkpoint"  # noqa: PT017
        assert f"{path}: " in str(error)  # noqa: PT017
        assert "cameras" in str(error)  # noqa: PT017


@pytest.mark.parametrize("rows", ["x", 3, {}, [3], [{}], [{"epoch": "x"}], [[1]]])
def test_the_table_inside_a_checkpoint(rows: Any, tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    content = {"state_dict": {}, "epoch": 0, "loops": {}}
    torch.save(content | {"rows": [{"epoch": 0, "val/abs_rel": 0.1}]}, path)
    assert read_checkpoint(path)["rows"]
    torch.save(content | {"rows": rows}, path)
    with refused(UserError, None, path, "table"):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "override",
    [
        "optimizer.lr=1e38",
        "optimizer.weight_decay=1e31",
        "loss.lambdas=[1e300,1,1]",
        f"data.batch_size={10**20}",
    ],
)
def test_numbers_beyond_all_bounds(override: str) -> None:
    option = override.partition("=")[0]

    with refused(UserError, option, "1e+", "got "):
        check_options(TrainOptions, composed("train", override, "output_dir=runs/x"))


def test_images_whose_names_are_no_utf_8(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path) + b"/in"
    os.mkdir(folder)  # noqa: PTH102 - bytes
    image = Image.fromarray(np.zeros((64, 80, 3), np.uint8))
    for name in (b"caf\xe9.png", b"caf\xef\xbf\xbd.png", b"z[b]x.png"):
        with open(folder + b"/" + name, "wb") as file:  # noqa: PTH123 - bytes
            image.save(file, "PNG")
    with open(folder + b"/no\xffimage.png", "wb") as file:  # noqa: PTH123 - bytes
        file.write(b"none")
    place = (f"input={tmp_path / 'in'}", f"output={tmp_path / 'out'}", "checkpoint=shipped")
    answer = call("predict", *place, "accelerator=cpu", "previews=false", cwd=tmp_path)
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "predicted 3 frames" in answer.stdout
    assert "no\\udcffimage.png: not a readable image" in answer.stdout
    names = {path.name.removesuffix("_depth.tiff") for path in (tmp_path / "out/frames").glob("*_depth.tiff")}
    assert names == {"caf�_png", "caf�_png_2", "z[b]x_png"}
    assert "no\\udcffimage.png" in (tmp_path / "out" / "predictions.csv").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["skipped"] == 1


def test_a_folder_of_options_in_two_words(tmp_path: Path) -> None:
    answer = call(
        "train.py", "--config-dir", str(tmp_path), "--cfg", "job", "optimizer.lr=3e-4", cwd=tmp_path
    )
    assert (answer.returncode, answer.stderr) == (0, "")
    assert "lr: 0.0003" in answer.stdout
    absent = call("train.py", "--config-dir", str(tmp_path / "none"), "--cfg", "job", cwd=tmp_path)
    assert absent.returncode == 2
    assert str(tmp_path / "none") in refusal(absent.stderr).message


@pytest.mark.parametrize(
    "wanted",
    [
        lambda: torch.empty(2**60, dtype=torch.uint8),
        lambda: np.ones((2**45, 2**15), np.uint8),
        lambda: [0] * 2**61,
    ],
)
def test_memory_that_is_out(wanted: Any) -> None:
    with refused(UserError, None, "memory is out (", "take less"), as_user_errors("take less"):
        wanted()
    with (
        refused(UserError, None, "memory is out (Tried to allocate 20.00 GiB)", "take less"),
        as_user_errors("take less"),
    ):
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB. GPU 0 has 8 GiB.")


def test_a_step_beyond_float32() -> None:
    weight = torch.nn.Parameter(torch.ones(3))
    weight.grad = torch.ones(3)
    optimizer = torch.optim.AdamW([weight], lr=1e38)
    with (
        refused(UserError, "optimizer.lr, optimizer.weight_decay"),
        as_user_errors("take less"),
    ):
        optimizer.step()


def test_what_a_user_wrote_keeps_its_traceback() -> None:
    with refused(RuntimeError, None, "mine"), as_user_errors("take less"):
        raise RuntimeError("mine: Broken pipe")


def test_another_process_of_a_training_that_is_gone(tmp_path: Path) -> None:
    commands = [[sys.executable, "-c", PEER, str(rank), str(tmp_path / "meet")] for rank in (1, 0)]
    with subprocess.Popen(commands[0]):
        answer = subprocess.run(commands[1], capture_output=True, text=True, timeout=120, check=False)
    assert answer.stdout.startswith("trainer.devices: "), answer.stderr
    assert answer.stdout.count("\n") == 1


class HandsOverAndDies(Dataset[torch.Tensor]):
    """Its first item is on its way when the process that made it ends."""

    def __len__(self) -> int:
        return 4

    def __getitem__(self, index: int) -> torch.Tensor:
        return torch.zeros(3)


def test_a_worker_that_ends_while_it_hands_over_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    module: dict[str, Any] = {"__name__": "multiprocessing.connection"}
    exec("def reset(*_): raise ConnectionResetError(104, 'Connection reset by peer')", module)
    batches = iter(DataLoader(HandsOverAndDies(), batch_size=2, num_workers=1))
    monkeypatch.setattr(multiprocessing.connection, "answer_challenge", module["reset"])

    with refused(UserError, "data.workers", "same command"), as_user_errors("smaller"):
        list(batches)


def test_a_data_set_s_own_connection_keeps_its_traceback() -> None:
    class Remote(Dataset[torch.Tensor]):
        def __len__(self) -> int:
            return 1

        def __getitem__(self, index: int) -> torch.Tensor:
            raise ConnectionResetError("of a server of its own")

    with refused(ConnectionResetError, None, "of a server"), as_user_errors("smaller"):
        list(DataLoader(Remote(), num_workers=0))

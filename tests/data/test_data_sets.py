"""Other data sets behind the same door: tested on, trained on besides, and how the command line says so."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from programs import call
from refusals import refusal, refused
from tiny_run import composed

from col3d.cli.choices import as_groups
from col3d.data.build import data_module, full_frames, sized_frames
from col3d.data.cache.prepare import prepare
from col3d.data.sized import Joined
from col3d.errors import DataError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions
from col3d.training.train import train

pytestmark = pytest.mark.end_to_end

Compose = Callable[..., dict[str, Any]]


@pytest.fixture
def simcol(tmp_path: Path, look: Any) -> Path:
    """Two videos in the format of SimCol3D."""
    from col3d.data.datasets.simcol3d import SimCol3D

    depth, _, mask = look("tube", SimCol3D.lens().rays())
    codes = (torch.where(mask, depth, 0.0)[0, 0].numpy() / 200 * 255).round().astype(np.uint16) * 256
    for video in ("Frames_S1", "Frames_S5"):
        folder = tmp_path / "simcol" / "SyntheticColon_I" / video
        folder.mkdir(parents=True)
        for number in range(2):
            colour = np.full((475, 475, 3), 100 + number, np.uint8)
            cv2.imwrite(str(folder / f"Depth_{number:04d}.png"), codes)
            cv2.imwrite(str(folder / f"FrameBuffer_{number:04d}.png"), colour)
    return tmp_path / "simcol"


def on_simcol(root: Path, place: str, part: str, video: str) -> list[str]:
    option = place.replace("/", ".")
    return [
        f"+data/source@data.{option}=simcol3d",
        f"data.{option}.root={root}",
        f"data.{option}.split.{part}=[{video}]",
    ]


def test_trained_on_one_tested_on_another(tiny: Compose, tmp_path: Path, simcol: Path, capsys: Any) -> None:
    train(tiny("model=bts", *on_simcol(simcol, "test", "test", "Frames_S*")))
    assert "test is of simcol3d, of which nothing was trained on (phantom was)" in capsys.readouterr().out
    with (tmp_path / "run" / "per_frame.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["data"], row["video"], row["frame"]) for row in rows] == [
        ("simcol3d", video, str(number)) for video in ("Frames_S1", "Frames_S5") for number in range(2)
    ]
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["data"], summary["split_name"], summary["shared_with_training"]) == ("simcol3d",) * 2 + (
        {},
    )
    checkpoint = tmp_path / "run" / "checkpoints" / "best.ckpt"
    other = ["data=simcol3d", f"data.root={simcol}", "data.split.test=[Frames_S1]"]
    evaluate(composed("evaluate", f"checkpoint={checkpoint}", "accelerator=cpu", *other))
    with next(tmp_path.glob("run/evaluation_simcol3d*/per_frame.csv")).open() as file:
        again = list(csv.DictReader(file))
    scores = [[float(row["abs_rel"]) for row in table] for table in (again, rows[:2])]
    assert scores[0] == pytest.approx(scores[1], rel=1e-3)


def test_trained_on_two(tiny: Compose, tmp_path: Path, simcol: Path) -> None:
    given = tiny(
        "model=bts", *on_simcol(simcol, "also.sim", "train", "Frames_S5"), "data.also.sim.weight=2.5"
    )
    options = check_options(TrainOptions, given)
    module = data_module(options.data, options.phantom, 0)
    frames = module.frames["train"]
    assert isinstance(frames, Joined)
    assert module.lengths() == {"train": 7, "val": 2, "test": 4}
    batches = [module.on_after_batch_transfer(batch, 0) for batch in module.train_dataloader()]
    videos = [video for batch in batches for video in batch["video"]]
    assert len(videos) == 5 + 5
    assert videos.count("Frames_S5") == 5
    train(given)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["data"] == "phantom"


@pytest.mark.parametrize(
    ("overrides", "about", "named"),
    [
        (["data.normals=none"], "data.also.sim.normals", ()),
        (["data.also.sim.normals=stored"], "data.normals", ("simcol3d", "derived or none")),
        (["data.also.sim.split.train=[]"], "data.also.sim.split.train", ("needed",)),
        (["data.also.sim.weight=0"], "data.also.sim.weight", ("greater than 0", "got 0")),
        (["data.split.val=[]"], "data.split.val", ("needed",)),
    ],
)
def test_what_does_not_belong_together(
    tiny: Compose, simcol: Path, overrides: list[str], about: str, named: tuple[str, ...]
) -> None:
    place = on_simcol(simcol, "also.sim", "train", "Frames_S5")
    with refused(UserError, about, *named):
        check_options(TrainOptions, tiny("model=bts", *place, *overrides))


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("data.test=simcol3d", ["+data/source@data.test=simcol3d"]),
        ("data.also=c3vdv2", ["+data/source@data.also.c3vdv2=c3vdv2"]),
        (
            "data.also=[c3vdv2,folder]",
            ["+data/source@data.also.c3vdv2=c3vdv2", "+data/source@data.also.folder=folder"],
        ),
        ("data.split=custom", ["data/split=custom"]),
        ("data.test=null", ["data.test=null"]),
        ("data.test.root=/x", ["data.test.root=/x"]),
        ("model=bts", ["model=bts"]),
    ],
)
def test_choices_inside_data_are_said_with_dots(argument: str, expected: list[str]) -> None:
    assert as_groups(argument) == expected


def test_the_command_line_takes_them(tmp_path: Path) -> None:
    answer = call("train.py", "data.test=simcol3d", "data.also=[c3vdv2]", "--cfg", "job", cwd=tmp_path)
    assert answer.returncode == 0
    assert "  test:\n" in answer.stdout
    assert "    c3vdv2:\n" in answer.stdout
    answer = call("train.py", "data.test=simcol", cwd=tmp_path)
    assert answer.returncode == 2
    refused = refusal(answer.stderr)
    assert refused.about == "data.test"
    assert "c3vd, c3vdv2, folder, phantom, simcol3d" in refused.message
    assert "'simcol3d'" in refused.message
    answer = call("train.py", "data.test=simcol3d", cwd=tmp_path)
    assert refusal(answer.stderr).about == "data.test.root"


def test_a_weight_that_shows_no_frame_is_refused(tiny: Compose, simcol: Path) -> None:
    given = tiny(
        "model=bts", *on_simcol(simcol, "also.sim", "train", "Frames_S5"), "data.also.sim.weight=0.1"
    )
    options = check_options(TrainOptions, given)
    with refused(DataError, "data.weight", "0.1 of the 2 frames of simcol3d"):
        data_module(options.data, options.phantom, 0)


@pytest.mark.parametrize("whole", [False, True])
def test_what_is_left_out_is_said_once(tiny: Compose, simcol: Path, whole: bool, capsys: Any) -> None:
    place = on_simcol(simcol, "test", "test", "'Frames_S1:0-0',cecum_t1_a")
    options = check_options(TrainOptions, tiny("model=bts", *place, "data.test.allow_missing=true"))
    source = options.data.tested
    if whole:
        frames = full_frames(source, options.phantom, "test")
    else:
        frames = sized_frames(source, options.phantom, "test", options.data.size)
    assert len(frames) == 1
    assert capsys.readouterr().out == "note: left out, because data.allow_missing=true: cecum_t1_a\n"


def test_a_store_of_another_unit_of_depth_does_not_serve(tmp_path: Path) -> None:
    clip = tmp_path / "mine" / "clip"
    clip.mkdir(parents=True)
    cv2.imwrite(str(clip / "0.png"), np.full((64, 80, 3), 90, np.uint8))
    cv2.imwrite(str(clip / "0_depth.png"), np.full((64, 80), 5000, np.uint16))
    camera = {"model": "pinhole", "size": [64, 80], "fx": 70.0, "fy": 70.0, "cx": 39.5, "cy": 31.5}
    (clip.parent / "camera.json").write_text(json.dumps(camera))
    place = ["data=folder", f"data.root={clip.parent}", "data.size=[64,80]"]
    prepare(composed("prepare", *place, "data.layout.depth_unit=0.01"))
    with refused(UserError, None, "clip was", "decoding is ", "0.01", ", not ", "0.02"):
        prepare(composed("prepare", *place, "data.layout.depth_unit=0.02"))

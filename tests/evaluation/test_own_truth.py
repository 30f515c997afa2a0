"""Truth of one's own frames: holes and wrong units are said, and what cannot be learned is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from refusals import refused
from tiny_run import SMALL, composed

from col3d.errors import UserError
from col3d.evaluation.evaluate import evaluate
from col3d.training.train import train

SIZE = (96, 128)
Write = Callable[..., None]


@pytest.fixture
def frames(tmp_path: Path) -> Write:
    plain = {"model": "pinhole", "size": list(SIZE), "fx": 100.0, "fy": 100.0, "cx": 63.5, "cy": 47.5}

    def write(share: float = 1.0, unit: float = 0.01) -> None:
        y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
        for place, video in enumerate("abc"):
            (tmp_path / "data" / video).mkdir(parents=True, exist_ok=True)
            for number in range(2):
                mm = 20 + 10 * np.sin(x / 20 + place) + y / 10
                known = np.random.default_rng(number).random(SIZE) < share
                codes = np.where(known, mm / unit, 0).round().astype(np.uint16)
                shade = (255 * 15 / mm).clip(0, 255).astype(np.uint8)
                cv2.imwrite(str(tmp_path / "data" / video / f"{number}.png"), np.dstack([shade] * 3))
                cv2.imwrite(str(tmp_path / "data" / video / f"{number}_depth.png"), codes)
        (tmp_path / "data" / "camera.json").write_text(json.dumps(plain))

    return write


def trained(tmp_path: Path, *overrides: str) -> Path:
    split = [
        f"data.split.{part}=[{video}]" for part, video in zip(("train", "val", "test"), "abc", strict=True)
    ]
    place = ("data=folder", f"data.root={tmp_path / 'data'}", f"output_dir={tmp_path / 'run'}", *split)
    train(
        composed(
            "train", "preset=smoke", SMALL, *place, "data.size=[64,64]", "callbacks.panels=1", *overrides
        )
    )
    return tmp_path / "run"


DEPTH_ALONE = ("model=bts", "data.layout.depth_unit=0.01")


def test_depth_with_holes_is_learned_and_said(
    frames: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames(share=0.05)
    run = trained(tmp_path, *DEPTH_ALONE)
    said = capsys.readouterr().out
    assert "a, frame 0 has depth at" in said
    assert "of those of its files" in said
    assert "train/loss 0.0000" not in said
    rows = (run / "per_frame.csv").read_text().splitlines()
    pixels = [int(row.rsplit(",", 1)[1]) for row in rows[1:]]
    assert all(200 < count < 1500 for count in pixels)  # of 4096; 5 in 100 of three to each
    for name in ("standard", "native"):
        evaluate(
            composed(
                "evaluate",
                f"checkpoint={run / 'checkpoints' / 'best.ckpt'}",
                f"protocol={name}",
                f"output_dir={tmp_path / name}",
                "workers=0",
                "panels=0",
            )
        )
    rows = (tmp_path / "native" / "per_frame.csv").read_text().splitlines()
    assert all(500 < int(row.rsplit(",", 1)[1]) < 700 for row in rows[1:])  # 5 in 100 of 12288


def test_normals_that_cannot_be_derived_are_no_lesson(frames: Write, tmp_path: Path) -> None:
    frames(share=0.02)
    with refused(UserError, "data.split.train", "(data.normals=derived)"):
        trained(tmp_path, "data.layout.depth_unit=0.01")
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_dense_truth_is_not_spoken_of(
    frames: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames()
    trained(tmp_path, *DEPTH_ALONE)
    assert "has depth at" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("unit", "named"),
    [
        ("0.00001", ("mm in the median", "data.layout.depth_unit=0.01")),
        ("10", ("e+04 to ", "data.layout.max_depth=100")),
    ],
)
def test_units_that_are_wrong_are_asked_about(
    unit: str, named: tuple[str, ...], frames: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames()
    options: tuple[Any, ...] = ("model=bts", f"data.layout.depth_unit={unit}")
    if unit == "10":
        with refused(UserError, None, *named):
            trained(tmp_path, *options)
        return
    trained(tmp_path, *options)
    said = capsys.readouterr().out
    assert all(part in said for part in named)

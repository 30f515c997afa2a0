"""Predictions of other programs: every form of file, how they are matched to frames, and what is refused."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
import torch
import yaml
from refusals import refused
from tiny_run import composed

from col3d.data.build import sized_frames
from col3d.errors import DataError, UserError
from col3d.evaluation.evaluate import evaluate
from col3d.evaluation.options import EvaluateOptions
from col3d.inference.trained_network import trained_network
from col3d.registry.refusals import check_options
from col3d.reports.per_frame import read_per_frame

pytestmark = pytest.mark.filterwarnings("ignore:.*pin_memory.*")
DATA = (
    *("data=phantom", "data/split=custom", "data.split.train=[cecum_t1_a]", "data.split.val=[trans_t1_a]"),
    *("data.split.test=[desc_t4_a,trans_t1_a:1-2]", "phantom.size=[64,80]", "phantom.frames_per_video=3"),
    *("data.size=[64,80]", "data.workers=0", "data.batch_size=2", "panels=0", "accelerator=cpu"),
)
FRAMES = {"desc_t4_a": (0, 1, 2), "trans_t1_a": (1, 2)}
Write = Callable[[Path, np.ndarray], Any]


@pytest.fixture(scope="module")
def truth(phantom_root: Path) -> dict[tuple[str, int], np.ndarray]:
    """True depth in mm of each scored frame, and of one that is not scored."""
    given = composed("evaluate", "predictions=x", *DATA, f"data.root={phantom_root}")
    options = check_options(EvaluateOptions, given)
    assert options.data is not None
    frames = sized_frames(options.data, options.phantom, "test", options.data.size)
    known = {(frame["video"], int(frame["frame"])): frame["depth"][0].numpy() for frame in frames}
    return known | {("trans_t1_a", 0): known["trans_t1_a", 1]}


def score(folder: Path, phantom_root: Path, *options: str) -> list[dict[str, str]]:
    """Rows of the table of one protocol."""
    place = (f"predictions={folder}", f"output_dir={folder.parent / 'scored'}", f"data.root={phantom_root}")
    evaluate(composed("evaluate", *place, *DATA, *options))
    return read_per_frame(folder.parent / "scored" / "per_frame.csv")


def errors(rows: list[dict[str, str]]) -> list[float]:
    return [float(row["abs_rel"]) for row in rows]


def png(path: Path, depth: np.ndarray) -> None:
    cv2.imwrite(str(path), np.round(depth * 256).astype(np.uint16))


FORMS: dict[str, tuple[str, Write, tuple[str, ...]]] = {
    "float32": ("{:04d}.npy", np.save, ()),
    "float16": ("{:04d}.npy", lambda path, depth: np.save(path, depth.astype(np.float16)), ()),
    "with axes of one": ("depth_{}.npy", lambda path, depth: np.save(path, depth[None, None]), ()),
    "packed": ("{:06d}_depth.npz", lambda path, depth: np.savez(path, depth=depth), ()),
    "metres": ("{}.npy", lambda path, depth: np.save(path, depth / 1000), ("reading.unit=1000",)),
    "16 bits": ("{:04d}_depth.png", png, ("reading.unit=0.00390625",)),
    "tiff": ("{:04d}.tiff", tifffile.imwrite, ()),
    "pfm": ("{:04d}.pfm", lambda path, depth: cv2.imwrite(str(path), depth), ()),
    "disparity": (
        "disp_{}.npy",
        lambda path, depth: np.save(path, 7 / np.maximum(depth, 1)),
        ("reading.holds=inverse_depth", "reading.unit=7"),
    ),
    "in folders": ("depth/{:04d}.npy", np.save, ("reading.depth='depth/{}.npy'",)),
    "beside others": ("{:04d}_depth.npy", np.save, ()),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_read(
    form: str, truth: dict[tuple[str, int], np.ndarray], phantom_root: Path, tmp_path: Path
) -> None:
    name, write, options = FORMS[form]
    for (video, number), depth in truth.items():
        path = tmp_path / "theirs" / video / name.format(number)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, 1.1 * depth)
        if form == "beside others":
            write(path.with_name(f"{number:04d}_normals.npy"), np.zeros((4, 5, 3)))
            write(path.with_name(f"{number:04d}_confidence.npy"), depth)
    rows = score(tmp_path / "theirs", phantom_root, *options)
    assert [(row["video"], int(row["frame"])) for row in rows] == [
        (video, number) for video, numbers in FRAMES.items() for number in numbers
    ]
    assert errors(rows) == pytest.approx([0.1] * 5, abs=2e-3)
    assert {row["model"] for row in rows} == {"theirs"}


def test_videos_in_one_array_and_other_sizes(
    truth: dict[tuple[str, int], np.ndarray], phantom_root: Path, tmp_path: Path
) -> None:
    (tmp_path / "theirs").mkdir()
    for video, count in (("desc_t4_a", 3), ("trans_t1_a", 3)):
        maps = np.stack([cv2.resize(truth[video, n], (384, 384)) for n in range(count)])
        np.save(tmp_path / "theirs" / f"{video}.npy", 0.9 * maps.astype(np.float16))
    assert errors(score(tmp_path / "theirs", phantom_root)) == pytest.approx([0.1] * 5, abs=2e-2)
    np.savez(tmp_path / "theirs" / "trans_t1_a.npz", maps[1:])  # the scored frames alone
    (tmp_path / "theirs" / "trans_t1_a.npy").unlink()
    assert errors(score(tmp_path / "theirs", phantom_root))[3:] == pytest.approx([0.0] * 2, abs=2e-2)


def test_frames_in_order(
    truth: dict[tuple[str, int], np.ndarray], phantom_root: Path, tmp_path: Path
) -> None:
    for video, numbers in FRAMES.items():
        (tmp_path / "theirs" / video).mkdir(parents=True)
        for place, number in enumerate(numbers):
            np.save(tmp_path / "theirs" / video / f"out{place + 10}.npy", truth[video, number])
    with refused(DataError, str(tmp_path / "theirs" / "desc_t4_a"), 3, "depth", "reading.order=position"):
        score(tmp_path / "theirs", phantom_root)
    rows = score(tmp_path / "theirs", phantom_root, "reading.order=position", "reading.name=Their Net")
    assert errors(rows) == pytest.approx([0.0] * 5, abs=1e-6)
    assert {row["model"] for row in rows} == {"Their Net"}


def test_a_network_has_the_same_rows_as_a_checkpoint_and_as_files(
    tiny_checkpoint: Path, phantom_root: Path, tmp_path: Path
) -> None:
    checkpoint = shutil.copy(tiny_checkpoint, tmp_path / "best.ckpt")
    given = ("output_dir=" + str(tmp_path / "of_checkpoint"), "batch_size=1", "workers=0", "panels=0")
    evaluate(composed("evaluate", f"checkpoint={checkpoint}", f"root={phantom_root}", *given))
    loaded = trained_network(Path(checkpoint))
    data, folder = loaded.trained.data, tmp_path / "theirs"
    for frame in sized_frames(
        data.model_copy(update={"root": str(phantom_root)}), loaded.trained.phantom, "test", data.size
    ):
        with torch.inference_mode():
            maps = loaded.network(frame["image"][None], frame["rays"][None])
        (folder / frame["video"]).mkdir(parents=True, exist_ok=True)
        for kind in ("depth", "normals"):
            name = folder / frame["video"] / f"{int(frame['frame'])}_{kind}.npy"
            np.save(name, maps[kind][0].numpy())
    split = [
        f"data.split.{part}=[{','.join(getattr(data.split, part))}]" for part in ("train", "val", "test")
    ]
    size = f"data.size=[{data.size[0]},{data.size[1]}]"
    place = (f"predictions={folder}", f"output_dir={tmp_path / 'of_files'}", f"data.root={phantom_root}")
    phantom = DATA[5:7]
    options = (
        "data=phantom",
        "data/split=custom",
        *split,
        size,
        *phantom,
        "reading.normals='{}_normals.npy'",
    )
    evaluate(composed("evaluate", *place, *options, *given[1:]))
    tables = [read_per_frame(tmp_path / name / "per_frame.csv") for name in ("of_checkpoint", "of_files")]
    for ours, theirs in zip(*tables, strict=True):
        assert {**ours, "model": "theirs"} == theirs
    content = yaml.safe_load((tmp_path / "of_files" / "config.yaml").read_text())
    assert content["predictions"]["folder"] == str(folder)


WRONG: dict[str, tuple[Write, tuple[str, ...], tuple[Any, ...]]] = {
    "metres": (lambda path, depth: np.save(path, depth / 1000), (), ("metres", "reading.unit=1000")),
    "nothing like depth": (lambda path, depth: np.save(path, depth + 1e5), (), ("reading.unit",)),
    "not finite": (lambda path, depth: np.save(path, np.full_like(depth, np.nan)), (), (5120,)),
    "three channels": (
        lambda path, depth: np.save(path, np.stack([depth, 2 * depth, depth], axis=-1)),
        (),
        ("(64, 80, 3)",),
    ),
    "text": (lambda path, depth: np.save(path, depth.astype(str)), (), ("<U",)),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_cannot_be_depth_is_refused(
    fault: str, truth: dict[tuple[str, int], np.ndarray], phantom_root: Path, tmp_path: Path
) -> None:
    write, options, named = WRONG[fault]
    for (video, number), depth in truth.items():
        (tmp_path / "theirs" / video).mkdir(parents=True, exist_ok=True)
        write(tmp_path / "theirs" / video / f"{number}.npy", depth)
    with refused(DataError, None, *named):
        score(tmp_path / "theirs", phantom_root, *options)
    assert not (tmp_path / "scored").exists()


@pytest.mark.parametrize(
    ("options", "about", "named"),
    [
        (["checkpoint=a.ckpt", "predictions=x"], "checkpoint", ["predictions=FOLDER"]),
        (["checkpoint=null"], "checkpoint", ["checkpoint=PATH"]),
        (["predictions=x"], "data", ["data=c3vd"]),
        (["predictions=x", "reading.unit=null"], "reading.unit", ["standard", "protocol=median_scaled"]),
        (["predictions=x", "protocol=mirrored"], "protocol", ["mirrored"]),
        (["predictions=x", "published=bts"], "published", ["predictions=x"]),
        (["predictions=x", "reading.depth=depth.npy"], "reading.depth", ["'depth.npy'"]),
    ],
)
def test_options_that_do_not_fit(options: list[str], about: str, named: list[str]) -> None:
    base = () if about == "data" else ("data=phantom",)
    with refused(UserError, about, *named):
        check_options(EvaluateOptions, composed("evaluate", *base, *options))


def test_options_of_others_are_in_the_way_before_anything_is_scored(
    truth: dict[tuple[str, int], np.ndarray], phantom_root: Path, tmp_path: Path
) -> None:
    for (video, number), depth in truth.items():
        (tmp_path / "theirs" / video).mkdir(parents=True, exist_ok=True)
        np.save(tmp_path / "theirs" / video / f"{number}.npy", depth)
    (tmp_path / "scored").mkdir()
    (tmp_path / "scored" / "config.yaml").write_text("mine")
    with refused(UserError, None, "config.yaml"):
        score(tmp_path / "theirs", phantom_root)
    assert [path.read_text() for path in (tmp_path / "scored").iterdir()] == ["mine"]

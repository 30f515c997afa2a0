"""The folder of the video that is fused, however it is called and written; and options that are empty."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from refusals import refused
from tiny_run import composed

from col3d.cli.paths import as_typed
from col3d.data.checks.options import VerifyOptions
from col3d.data.download.options import DownloadOptions
from col3d.errors import DataError, UserError
from col3d.evaluation.options import EvaluateOptions
from col3d.inference.fusion.video import video_of
from col3d.inference.options import ExportOptions, FuseOptions, PredictOptions
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions

NAMES = (
    *(
        "my video",
        "[a]",
        "内視鏡",
        "it's",
        "-v",
        "v.",
        "a=b",
        "a,b",
        "%02d",
        "*",
        "null",
        "123",
        "(x)",
        "{x}",
        "#1",
    ),
    *(
        "a'b\"c",
        "<b>x",
        "&amp;",
        "a\\b",
        "~",
        "a;b",
        "a$b",
        " led",
        "trailing ",
        "x" * 200,
        "desc_t4_a_s7",
        "c1v1",
    ),
)


def video(given: str) -> Any:
    options = composed("fuse", *as_typed([f"video={given}", "output=out"], "fuse"))
    return video_of(check_options(FuseOptions, options))


@pytest.mark.parametrize("name", NAMES)
def test_a_folder_of_any_name_is_the_video(name: str, rendered: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(rendered, tmp_path / name)
    for given in (str(folder), f"{folder}/"):
        assert [frame.number for frame in video(given).frames] == [0, 1, 2]
    assert [frame.number for frame in video(f"{folder}:1-2").frames] == [1, 2]


@pytest.mark.parametrize(
    ("given", "numbers"),
    [
        (".", [0, 1, 2]),
        ("./", [0, 1, 2]),
        (".:0-1", [0, 1]),
        ("../{name}/:0-1", [0, 1]),
        ("../{name}/.", [0, 1, 2]),
        ("../{name}/../{name}:2-2", [2]),
    ],
)
def test_a_folder_that_is_written_from_elsewhere(
    given: str, numbers: list[int], rendered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(rendered)
    assert [frame.number for frame in video(given.format(name=rendered.name)).frames] == numbers


@pytest.mark.parametrize(("name", "why"), [("a:b", "a colon"), ("a:0-1", "a colon"), (".hidden", "hidden")])
def test_names_that_no_video_can_have(name: str, why: str, rendered: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(rendered, tmp_path / name)
    with refused(UserError, "video", folder, f" {why}"):
        video(str(folder))


@pytest.mark.parametrize(
    ("given", "about", "named"),
    [
        ("/", "video", "/ has no name"),
        ("{root}", "video", "{root} is no folder"),
        ("{root}/none", "video", "{root}/none is no folder"),
        ("{root}/{name}/0000_color.png", "video", "{name}/0000_color.png is no folder"),
        ("{root}/{name}:0", "split entry '{name}:0'", "VIDEO:FIRST-LAST"),
        ("{root}/{name}:2-1", "split entry '{name}:2-1'", "after the last"),
    ],
)
def test_what_is_no_video_is_refused(given: str, about: str, named: str, rendered: Path) -> None:
    places = {"root": rendered.parent, "name": rendered.name}
    with refused((UserError, DataError), about.format(**places), named.format(**places)):
        video(given.format(**places))


@pytest.mark.parametrize("text", ["''", "' '"])
@pytest.mark.parametrize(
    ("program", "options", "option", "more"),
    [
        ("fuse", FuseOptions, "video", ("output=x",)),
        ("fuse", FuseOptions, "output", ("video=x",)),
        ("fuse", FuseOptions, "checkpoint", ("video=x", "output=x")),
        ("predict", PredictOptions, "input", ("output=x", "checkpoint=x")),
        ("predict", PredictOptions, "output", ("input=x", "checkpoint=x")),
        ("predict", PredictOptions, "checkpoint", ("input=x", "output=x")),
        ("export", ExportOptions, "checkpoint", ("output=x.onnx",)),
        ("evaluate", EvaluateOptions, "checkpoint", ()),
        ("train", TrainOptions, "init.checkpoint", ("output_dir=x",)),
        ("train", TrainOptions, "model.pretrained", ("output_dir=x",)),
        ("train", TrainOptions, "data.root", ("output_dir=x",)),
        ("download", DownloadOptions, "data.root", ("data=c3vd",)),
        ("verify", VerifyOptions, "output", ()),
    ],
)
def test_a_path_that_is_empty_is_not_the_current_folder(
    program: str, options: Any, option: str, more: tuple[str, ...], text: str
) -> None:
    with refused(UserError, option, "not empty", f"got {text}"):
        check_options(options, composed(program, *more, f"{option}={text}"))

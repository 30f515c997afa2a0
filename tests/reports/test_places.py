"""What is meant for others names no folder, user or host of this machine."""

import getpass
import socket
from pathlib import Path

import pytest
from fake_runs import change_summary, write_run

from col3d.reports.__main__ import main
from col3d.reports.places import command_without_places, last_name, without_places
from col3d.reports.run_page import write_run_page


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/home/ann/C3VD", "C3VD"),
        ("/home/ann/my data/C3VD v2", "C3VD v2"),
        ("~/C3VD", "C3VD"),
        ("~ann/C3VD", "C3VD"),
        ("../../ann/C3VD", "C3VD"),
        ("file:///home/ann/C3VD", "C3VD"),
        ("/home/ann/a.png: expected 16 bits, got 8", "a.png: expected 16 bits, got 8"),
        ("reads /home/ann/a and '/srv/ann/b c'", "reads a and 'b c'"),
        ("[/home/ann/a,/home/ann/b]", "[a,b]"),
        ("runs/default/checkpoints/best.ckpt", "runs/default/checkpoints/best.ckpt"),
        ("12 mm/s, and/or, 1 / 2, https://arxiv.org/abs/2311.18664", None),
        (str(Path.home()), "folder"),
        (f"/home/{getpass.getuser()}", "folder"),
        (f"/data/{socket.gethostname()}/", "folder"),
    ],
)
def test_paths_in_texts(text: str, expected: str | None) -> None:
    if "'" in text:  # a quoted path with a space is told from text in a command alone
        assert "/home" not in without_places(text)
    else:
        assert without_places(text) == (expected or text)
    assert without_places({"a": [text, 3], "b": None})["a"][0] == without_places(text)


def test_commands() -> None:
    given = "python train.py 'data.root=/home/ann/my data/C3VD' 'paths=[/srv/ann/x,/srv/ann/y]' seed=1"
    assert command_without_places(given) == "python train.py data.root=C3VD 'paths=[x,y]' seed=1"
    assert "ann" not in command_without_places("python train.py data.root=/home/ann/it's")
    assert last_name("/") == "folder"


def test_pages_and_reports(tmp_path: Path) -> None:
    secret = "/home/ann/secret"
    run = write_run(
        tmp_path / "runs" / "a",
        facts={"command": f"python train.py data.root={secret}/C3VD output_dir={secret}/run"},
        data__root=f"{secret}/C3VD",
        output_dir=f"{secret}/run",
    )
    change_summary(run, checkpoint=f"{secret}/run/checkpoints/best.ckpt")
    (tmp_path / "runs" / "b").mkdir()
    (tmp_path / "runs" / "b" / "summary.json").write_text("{")
    assert main([str(tmp_path / "runs"), str(tmp_path / "out")]) == 0
    write_run_page(run)
    for page in (run / "run.html", *(tmp_path / "out").rglob("*.*")):
        content = page.read_bytes()
        for name in (b"/home", b"ann/", b"secret", str(tmp_path).encode()):
            assert name not in content, page
    text = (run / "run.html").read_text(encoding="utf-8")
    assert "data.root=C3VD" in text
    assert "<code>best.ckpt</code>" in text

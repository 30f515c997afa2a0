"""Checkpoints are there whole or not at all; what has changed or asks for more than values is not opened."""

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from refusals import refused

from col3d.errors import UserError
from col3d.runs.checkpoints import CheckpointFiles, DamagedError, read_checkpoint


def content(value: float) -> dict[str, Any]:
    return {"state_dict": {"weight": torch.full((1000,), value)}, "epoch": 3, "loops": {}}


def test_what_is_saved_is_read(tmp_path: Path) -> None:
    path = tmp_path / "new" / "last.ckpt"
    CheckpointFiles().save_checkpoint(content(1.0), path)
    CheckpointFiles().save_checkpoint(content(2.0), path)
    assert torch.equal(read_checkpoint(path)["state_dict"]["weight"], torch.full((1000,), 2.0))
    assert [file.name for file in path.parent.iterdir()] == ["last.ckpt"]


@pytest.mark.parametrize("written", [0, 100, 3000])
def test_a_full_disk_leaves_the_checkpoint_that_was(
    written: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "last.ckpt"
    CheckpointFiles().save_checkpoint(content(1.0), path)
    opened = Path.open

    class Full:
        """A file on a disk with so many bytes left."""

        def __init__(self, file: Any) -> None:
            self.file, self.left = file, written

        def __enter__(self) -> "Full":
            return self

        def __exit__(self, *error: object) -> None:
            self.file.close()

        def __getattr__(self, name: str) -> Any:
            return getattr(self.file, name)

        def write(self, data: bytes) -> int:
            self.left -= len(data)
            if self.left < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return int(self.file.write(data))

    monkeypatch.setattr(Path, "open", lambda self, *mode, **options: Full(opened(self, *mode, **options)))
    with refused(OSError, None, path) as caught:
        CheckpointFiles().save_checkpoint(content(2.0), path)
    assert caught.value.errno == errno.ENOSPC
    monkeypatch.undo()
    assert read_checkpoint(path)["state_dict"]["weight"][0] == 1
    assert [file.name for file in tmp_path.iterdir()] == ["last.ckpt"]


def test_a_folder_that_may_not_be_written_to_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with refused(OSError, None, tmp_path / "file"):
        CheckpointFiles().save_checkpoint(content(1.0), tmp_path / "file" / "last.ckpt")


def test_damage_is_seen(tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    CheckpointFiles().save_checkpoint(content(1.0), path)
    whole = path.read_bytes()
    weights = whole.index(torch.ones(100).numpy().tobytes())
    flipped = bytearray(whole)
    flipped[weights + 50] ^= 1
    for damaged in (bytes(flipped), whole[:-30], whole[: len(whole) // 2], b"", b"PK\x03\x04"):
        path.write_bytes(damaged)
        with refused(DamagedError, None, path):
            read_checkpoint(path)


def test_whatever_bit_flips_it_is_damage_or_nothing(tmp_path: Path) -> None:
    path, random = tmp_path / "last.ckpt", np.random.default_rng(0)
    CheckpointFiles().save_checkpoint(content(1.0), path)
    whole = path.read_bytes()
    for place in random.integers(len(whole), size=300):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << random.integers(8)
        path.write_bytes(flipped)
        try:
            found = read_checkpoint(path)
        except (DamagedError, UserError):
            continue
        assert torch.equal(found["state_dict"]["weight"], torch.ones(1000))


class Payload:
    """What a pickle can do to whoever opens it."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> Any:
        return (Path.touch, (self.marker,))


def test_a_malicious_file_does_nothing(tmp_path: Path) -> None:
    marker, path = tmp_path / "executed", tmp_path / "last.ckpt"
    torch.save({**content(1.0), "callbacks": Payload(marker)}, path)
    with refused(UserError, None, path, "plain values"):
        read_checkpoint(path)
    assert not marker.exists()
    torch.load(path, weights_only=False)
    assert marker.exists()  # it would have


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    torch.save({"weight": torch.ones(3)}, tmp_path / "last.ckpt")
    with refused(UserError, None, tmp_path / "last.ckpt", "training"):
        read_checkpoint(tmp_path / "last.ckpt")

"""Frames and files of runs that are lost or changed."""

import os
import random
from collections.abc import Callable
from pathlib import Path

from tests.faults.training import LostError
from tests.faults.trial import Trial

TRAINED_FRAME = Path("cecum_t1_a") / "0001_color.png"


def deleted_frame(trial: Trial) -> list[str]:
    """A colour file vanishes."""
    trial.own_data()
    path, aside = trial.root / TRAINED_FRAME, trial.place / "aside"
    training = trial.start_to_second_epoch()
    path.rename(aside)
    answer = trial.ended(training)
    aside.rename(path)
    return [*answer, trial.then()]


def spoiled_frame(trial: Trial) -> list[str]:
    """A colour file becomes noise; it is put back only after the command was tried."""
    trial.own_data()
    path = trial.root / TRAINED_FRAME
    content = path.read_bytes()
    training = trial.start_to_second_epoch()
    path.write_bytes(random.Random(0).randbytes(len(content)))
    answer = trial.ended(training)
    refused = trial.start()
    code = refused.end()
    path.write_bytes(content)
    return [*answer, f"exit code {code} ({trial.line_of(refused)}); with the file back it {trial.then()}"]


def damaged(trial: Trial, damage: Callable[[Path], None], *names: str) -> list[str]:
    """Files change after a training was killed in its second epoch."""
    trial.start_to_second_epoch().close()
    for name in names:
        damage(trial.run / name)
    return _told_by_the_next(trial)


def damaged_end(trial: Trial, damage: Callable[[Path], None], *names: str) -> list[str]:
    """Files change after a training finished."""
    if trial.start().end():
        raise LostError("the training failed before the fault")
    for name in names:
        damage(trial.run / name)
    return _told_by_the_next(trial)


def _told_by_the_next(trial: Trial) -> list[str]:
    """The first session cannot say anything of what is done to its files afterwards."""
    training = trial.start()
    answer = trial.ended(training)
    if answer[0] != "0":
        return [*answer, f"EXIT CODE {answer[0]}"]
    if "finished before" in training.said:
        return [*answer, f"this was it: showed the table of the finished run; {trial.compared()}"]
    return [*answer, f"this was it: {trial.way_of(training)}{trial.compared()}"]


def truncated(path: Path) -> None:
    """Cut to its first half."""
    os.truncate(path, path.stat().st_size // 2)


def emptied(path: Path) -> None:
    """Cut to nothing, as after a power cut."""
    os.truncate(path, 0)


def noised(path: Path) -> None:
    """Its first byte is no text any more."""
    path.write_bytes(b"\xff" + path.read_bytes()[1:])


def flipped(path: Path) -> None:
    """One bit in the middle changed."""
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))

"""A network and a clock that do not do what they should."""

import csv
import socket
import time
from datetime import datetime

from col3d.io.run_files import STATUS, read_plain
from tests.faults.training import LONGEST, NotMadeError
from tests.faults.trial import EPOCHS, Trial

JUMPING_CLOCK = """
import datetime, itertools, time

hours, calls, real, now = (0, 7, -5, 30, -48), itertools.count(), time.time, datetime.datetime.now
offset = lambda: 3600 * hours[next(calls) // 3 % len(hours)]

class Jumping(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return now(tz) + datetime.timedelta(seconds=offset())

datetime.datetime = Jumping
time.time = lambda: real() + offset()
time.time_ns = lambda: int(1e9 * time.time())
"""
"""A sitecustomize.py that puts the clock forward and back by hours; time.monotonic stays what it is."""


def no_wandb(trial: Trial, kind: str) -> list[str]:
    """W&B is asked for and not to be had: without a key, or its server `refuses` or is `silent`."""
    trial.more += ["logger=wandb", "logger.wandb.offline=false"]
    environment = {"HOME": str(trial.place), "WANDB_API_KEY": "0123456789" * 4}
    environment |= {"WANDB_ERROR_REPORTING": "false", "NETRC": str(trial.place / "none")}
    server = trial.keep.enter_context(socket.socket())
    server.bind(("127.0.0.1", 0))
    if kind == "silent":
        server.listen()
    environment["WANDB_BASE_URL"] = f"http://127.0.0.1:{server.getsockname()[1]}"
    if kind == "no key":
        del environment["WANDB_API_KEY"]
    begin = time.monotonic()
    training = trial.start(environment)
    answer = trial.ended(training)
    kept = len(list((trial.run / "wandb").glob("offline-run-*/*.wandb")))
    after = f"{time.monotonic() - begin:.0f} s in all, {kept} offline run kept; {trial.compared()}"
    return [*answer, f"not needed: {after}"]


def jumping_clock(trial: Trial) -> list[str]:
    """By hours, forward and back, every few times that it is read."""
    (trial.place / "clock").mkdir()
    (trial.place / "clock" / "sitecustomize.py").write_text(JUMPING_CLOCK)
    begin, begun = time.monotonic(), datetime.now().astimezone()
    training = trial.start({"PYTHONPATH": str(trial.place / "clock")})
    code = training.end()
    taken, status = time.monotonic() - begin, read_plain(trial.run / STATUS)
    stamps = [datetime.fromisoformat(status[name]) for name in ("started", "updated")]
    if all(abs((stamp - begun).total_seconds()) < LONGEST for stamp in stamps):
        raise NotMadeError("the clock did not jump")
    lines = [line for line in training.said.splitlines() if line.startswith("epoch ")]
    paces = [float(line.split(" s an epoch")[0].split()[-1]) for line in lines]
    with (trial.run / "metrics.csv").open(newline="") as file:
        epochs = [row["epoch"] for row in csv.DictReader(file)]
    sane = 0 < status["seconds"] < taken and all(0 < pace < taken for pace in paces)
    sane = sane and epochs == [str(epoch) for epoch in range(EPOCHS)]
    seconds = "seconds, pace and epochs are right" if sane else "WRONG SECONDS, PACE OR EPOCHS"
    answer = [str(code), trial.line_of(training), trial.state()]
    return [*answer, f"not needed: {seconds}, stamps are the clock's; {trial.compared()}"]

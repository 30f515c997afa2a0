"""Processes that are asked to end, die, or get in each other's way."""

import os
import signal

from tests.faults.trial import Trial


def signalled(trial: Trial, signum: int, group: bool = False) -> list[str]:
    """A signal in the second epoch."""
    training = trial.start_to_second_epoch()
    training.send(signum, group)
    return [*trial.ended(training), trial.then()]


def signalled_with_workers(trial: Trial, signum: int) -> list[str]:
    """The same, to all processes of a training that has more."""
    trial.more.append("data.workers=2")
    return signalled(trial, signum, group=True)


def killed_while_writing(trial: Trial, name: str) -> list[str]:
    """Half a checkpoint is there when the process dies."""
    partial_file = trial.run / "checkpoints" / f"{name}.ckpt.partial"
    training = trial.start_to_second_epoch() if name == "last" else trial.start()
    while not partial_file.is_file():
        training.until(partial_file.is_file)
        training.send(signal.SIGSTOP)  # a look without hurry
        if not partial_file.is_file():
            training.send(signal.SIGCONT)
    training.send(signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


def killed_worker(trial: Trial) -> list[str]:
    """One of two processes that load data."""
    trial.more.append("data.workers=2")
    training = trial.start_to_second_epoch()
    os.kill(training.workers()[0], signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


def killed_worker_of_the_test(trial: Trial) -> list[str]:
    """The same after the last epoch, while the best checkpoint is evaluated."""
    trial.more.append("data.workers=2")
    training = trial.start()
    training.until(lambda: len(training.workers()) == 4)
    before = set(training.workers())
    training.until(lambda: bool(set(training.workers()) - before))
    os.kill(min(set(training.workers()) - before), signal.SIGKILL)
    return [*trial.ended(training), trial.then()]


def two_on_one_folder(trial: Trial) -> list[str]:
    """The second is told to stay away, and disturbs nothing."""
    first = trial.start_to_second_epoch()
    first.send(signal.SIGSTOP)  # else it is done before the second has begun
    second = trial.start()
    code, said = second.end(), trial.line_of(second)
    first.send(signal.SIGCONT)
    state = trial.state()
    answer = [f"{code}, the first {first.end()}", said, state]
    return [*answer, f"the first: {trial.compared()}"]

"""Resumption of Optuna searches: trials that are left in a study, and trials that were interrupted."""

from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from col3d.io.run_files import read_sweep

FILE = "sqlite:///"


def simplex(u: float | int, v: float | int) -> list[float]:
    """Map a point of the unit square to three weights that add up to 1; uniform points give uniform weights.

    >>> simplex(0.25, 0.5)
    [0.5, 0.25, 0.25]
    """
    rest = float(u) ** 0.5
    second = round(rest * (1 - float(v)), 6)
    third = round(rest * float(v), 6)
    return [round(1 - second - third, 6), second, third]


def trials_left(total: int, storage: str, study: str) -> int:
    """Return how many trials a study lacks to have `total` complete ones."""
    existing = _study(storage, study)
    return int(total) if existing is None else max(0, int(total) - len(_trials(existing, "COMPLETE")))


def trials_begun(storage: str, study: str) -> int:
    """Return how many trials a study has, complete or not."""
    existing = _study(storage, study)
    return 0 if existing is None else len(existing.get_trials(deepcopy=False))


def take_up(hydra: DictConfig) -> None:
    """Enqueue the trials of a search that were interrupted; in their folders they go on from a checkpoint."""
    if not str(hydra.sweeper._target_).endswith(".OptunaSweeper") or hydra.sweeper.storage is None:
        return
    sweep = Path(hydra.sweep.dir)
    sweep.mkdir(parents=True, exist_ok=True)  # SQLite writes here
    study = _study(str(hydra.sweeper.storage), str(hydra.sweeper.study_name))
    if study is None or any(job.state == "running" for job in read_sweep(sweep)):
        return
    from optuna.trial import TrialState

    for trial in _trials(study, "RUNNING"):
        study.tell(trial.number, state=TrialState.FAIL)
        study.enqueue_trial(trial.params)


def _study(storage: str, name: str) -> Any:
    """Load the study, or return None if it has not begun."""
    if storage.startswith(FILE) and not Path(storage.removeprefix(FILE)).is_file():
        return None
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        return optuna.load_study(study_name=name, storage=storage)
    except KeyError:
        return None


def _trials(study: Any, state: str) -> list[Any]:
    return [trial for trial in study.get_trials(deepcopy=False) if trial.state.name == state]


OmegaConf.register_new_resolver("simplex", simplex, replace=True)
OmegaConf.register_new_resolver("trials_left", trials_left, replace=True)
OmegaConf.register_new_resolver("trials_begun", trials_begun, replace=True)

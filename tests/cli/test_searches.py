"""Searches: weightings that add up to 1, studies that go on, trials that were cut off first."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from programs import call
from tiny_run import SMALL, TINY, composed

from col3d.cli.searches import simplex, take_up, trials_left
from col3d.registry.refusals import check_options
from col3d.training.options import TrainOptions

pytestmark = [
    pytest.mark.end_to_end,
    pytest.mark.filterwarnings(
        "ignore::DeprecationWarning", "ignore::FutureWarning", "ignore:.*experimental"
    ),
]


def test_weightings_add_up_to_1_and_are_uniform() -> None:
    corners = [simplex(u, v) for u in (0, 1) for v in (0, 1)]
    assert corners == [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    points = np.random.default_rng(0).random((20_000, 2))
    weights = np.array([simplex(u, v) for u, v in points])
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(weights.mean(axis=0), 1 / 3, atol=0.01)  # of a uniform law on the triangle
    np.testing.assert_allclose(weights.var(axis=0), 1 / 18, atol=0.002)


def test_the_experiment_is_one_of_ours() -> None:
    given = composed("train", "experiment=lambda_search", "search.u=0.25", "search.v=0.5", "output_dir=x")
    assert check_options(TrainOptions, given).loss.lambdas == [0.5, 0.25, 0.25]


def test_a_trial_that_was_cut_off_comes_first(tmp_path: Path) -> None:
    import optuna

    storage = f"sqlite:///{tmp_path}/study.db"
    assert trials_left(5, storage, "lambdas") == 5
    study = optuna.create_study(study_name="lambdas", storage=storage)
    study.tell(study.ask(), 1.0)
    cut = study.ask()
    params = {"search.u": cut.suggest_float("search.u", 0, 1)}
    assert trials_left(5, storage, "lambdas") == 4
    sweeper = {"_target_": "hydra_plugins.x.OptunaSweeper", "storage": storage, "study_name": "lambdas"}
    hydra = OmegaConf.create({"sweeper": sweeper, "sweep": {"dir": str(tmp_path)}})
    take_up(hydra)
    study = optuna.load_study(study_name="lambdas", storage=storage)
    assert [trial.state.name for trial in study.trials] == ["COMPLETE", "FAIL", "WAITING"]
    again = study.ask()
    assert {"search.u": again.suggest_float("search.u", 0, 1)} == params
    assert trials_left(5, storage, "other") == 5


def test_a_search_ends_with_as_many_trials_as_are_asked_for(tmp_path: Path) -> None:
    search = ["experiment=lambda_search", *TINY, SMALL, f"hydra.sweep.dir={tmp_path / 'search'}"]
    place = f"data.root={tmp_path / 'phantom'}"
    for trials, folders in ((1, 1), (2, 2), (2, 2)):
        answer = call("train.py", *search, place, f"search.trials={trials}", cwd=tmp_path)
        assert answer.returncode == 0, answer.stderr
        assert len(list((tmp_path / "search").glob("*/result.json"))) == folders
        assert "Failed" not in answer.stdout
    results = OmegaConf.load(tmp_path / "search" / "optimization_results.yaml")
    assert {len(solution["values"]) for solution in results["solutions"]} == {2}

"""Calls to the system that fail do no harm: a few here, all by `python -m tests.faults.injected`."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.faults.injected import Tally, copied, in_spread_order, one, spread
from tests.faults.injector import KINDS, Injector
from tests.faults.small_runs import RUNS, SmallRun, prepared_place

pytestmark = pytest.mark.end_to_end

MOST = {"report": 2, "predict": 1}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("injected")


@pytest.fixture(scope="module")
def injector(place: Path) -> Iterator[Injector]:
    with closing(Injector(place)) as made:
        yield made


@pytest.fixture(scope="module")
def start(place: Path, injector: Injector) -> Path:
    return prepared_place(place / "trial", injector).rename(place / "start")


def undisturbed(run: SmallRun, start: Path, injector: Injector) -> tuple[dict[str, int], dict[str, str]]:
    whole = start.with_name("trial")
    copied(start, whole)
    run.make_ready(whole)
    code, calls, said = injector.run(run.name, run.given(whole), whole)
    assert code == 0, said
    return calls, run.result(whole)


@pytest.mark.parametrize("name", MOST)
def test_calls_that_fail_do_no_harm(name: str, start: Path, injector: Injector) -> None:
    run = next(run for run in RUNS if run.name == name)
    calls, expected = undisturbed(run, start, injector)
    tally = Tally()
    for kind in KINDS:
        for n in spread(calls[kind], MOST[name]):
            found = one(run, start, start.with_name("trial"), injector, kind, n, False, expected, tally)
            assert found == "", (kind, n)
    assert tally.codes[2] > MOST[name]  # they did fail


def test_harm_is_noticed(start: Path, injector: Injector) -> None:
    run = next(run for run in RUNS if run.name == "report")
    _, expected = undisturbed(run, start, injector)
    whole, other = start.with_name("trial"), {**expected, "paper/report.md": "other"}
    assert "differs in paper/report.md" in one(run, start, whole, injector, "write", 1, False, other, Tally())
    (whole / "mine.csv").write_text("changed")
    assert run.others(whole) != run.others(start)
    assert spread(11, 3) == [1, 6, 11]
    assert spread(2, 3) == [1, 2]
    assert spread(11, 1) == [6]
    assert in_spread_order([1, 2, 3, 4, 5, 6, 7, 8]) == [1, 5, 3, 7, 2, 6, 4, 8]
    assert {run.name for run in RUNS} == {
        *("train", "prepare", "evaluate", "predict", "export", "fuse", "report")
    }

"""Optional outputs of a run (cost, pictures, page, logs), made after its result and again if missing."""

from collections.abc import Mapping, Sequence
from typing import Any

from lightning import seed_everything
from lightning.pytorch.loggers import Logger

from col3d.data.build import data_module
from col3d.errors import UserError
from col3d.evaluation.results import SUMMARY, Results, facts_of
from col3d.evaluation.scored_part import Scored
from col3d.inference.trained_network import TrainedNetwork
from col3d.io.json_files import write_json
from col3d.io.run_files import read_plain
from col3d.reports.run_page import PAGE, write_run_page
from col3d.reports.summary import print_summary
from col3d.runs.checkpoints import DamagedError, read_checkpoint
from col3d.runs.decorations import Decorations
from col3d.runs.environment import device_for
from col3d.runs.folder import BEST, DECORATIONS, FILES, KIND, PREDICTIONS, RunFolder, say_changes
from col3d.runs.rank import is_first, wait_for_all
from col3d.runs.starts import this_start
from col3d.training.cost import measure_cost
from col3d.training.final_test import best_network, score_best
from col3d.training.options import TrainOptions
from col3d.training.run_request import weight_files

AGAIN = "the result stands; the same command makes it again"


def decorate(
    folder: RunFolder,
    results: Results,
    summary: Mapping[str, Any],
    best: TrainedNetwork,
    loggers: Sequence[Logger],
    wanted: Sequence[str] = DECORATIONS,
) -> Mapping[str, Any]:
    """Make optional outputs after the result is written; a failure prints a note and can be made up later.

    Every process of a training draws the frames that it has seen; the first one does the rest.

    Args:
        folder: folder of the run.
        results: results of the test.
        summary: content of summary.json.
        best: network of the best epoch.
        loggers: loggers that receive the results.
        wanted: names of the outputs to make.

    Returns:
        The summary, with the cost.
    """
    made = Decorations(AGAIN)
    if "panels" in wanted:
        if is_first():
            with made.attempt("panels"):
                results.panels.clear()
        wait_for_all()
        with made.attempt("panels"):
            results.panels.draw()
        wait_for_all()
    if not is_first():
        return summary
    if "cost" in wanted:
        with made.attempt("cost"):
            summary = {**summary, "cost": measure_cost(best.network, best.trained.size_hw)}
            write_json(folder.path / SUMMARY, summary)
    for logger in loggers:
        with made.attempt(type(logger).__name__):
            results.log(logger, summary)
    with made.attempt(PAGE):
        write_run_page(folder.path)
    folder.decorated(made.failed(DECORATIONS))
    return summary


def show_again(options: TrainOptions, folder: RunFolder) -> None:
    """Print the table of a finished run and changes since then; make optional outputs that it lacks."""
    if summary := read_plain(folder.path / SUMMARY):
        print_summary(summary)
    now = this_start(options.data, options.phantom, weight_files(options))
    say_changes(folder.starts.changes(now), "this run's last start")
    try:
        folder.check_best(read_checkpoint(folder.path / BEST))
    except (OSError, DamagedError, UserError) as error:
        print(f"note: {error}", flush=True)
    if undone := folder.undone:
        made = Decorations(AGAIN)
        with made.attempt(", ".join(undone)):
            _made_again(options, folder, undone)
    print(f"finished before: {folder.path}; overwrite=true trains again", flush=True)


def _made_again(options: TrainOptions, folder: RunFolder, undone: Sequence[str]) -> None:
    """Make optional outputs of a finished run; its numbers stay unchanged."""
    folder.owned.adopt(*FILES)
    summary = read_plain(folder.path / SUMMARY)
    seed_everything(options.seed, workers=True, verbose=False)
    data = data_module(options.data, options.phantom, options.seed, ["test"])
    best = best_network(folder)
    scored = Scored.after(options.data, "test")
    facts = facts_of(options.model.name, options.seed, scored, options.one_protocol[0])
    protocol = options.one_protocol[1]
    results = Results(facts, folder.path, KIND, scored, data.lengths(), options.callbacks.panels, protocol)
    device = device_for(options.trainer.accelerator)
    score_best(options, folder, best, data, results, device, predictions=PREDICTIONS in undone)
    decorate(folder, results, summary, best, [], [name for name in undone if name in DECORATIONS])

"""Cost, pictures, page and logs of a run: made when its result is there, and again where they are missing."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightning import Callback, seed_everything
from lightning.pytorch.loggers import Logger

from col3d.app import build
from col3d.app.checkpoints import DamagedError, read_checkpoint
from col3d.app.config import TrainOptions
from col3d.app.cost import measure_cost
from col3d.app.decorations import Decorations
from col3d.app.frames import data_module
from col3d.app.machine import make_trainer
from col3d.app.rank import is_first
from col3d.app.results import SUMMARY, Results, facts_of
from col3d.app.run_folder import (
    BEST,
    DECORATIONS,
    FILES,
    KIND,
    PREDICTIONS,
    RunFolder,
    say_changes,
)
from col3d.app.scored import Scored
from col3d.app.starts import this_start
from col3d.callbacks import SavePredictions
from col3d.checks import UserError
from col3d.reports.jobs import read_plain
from col3d.reports.run_page import PAGE, write_run_page
from col3d.reports.summary import print_summary, write_json
from col3d.tasks import SupervisedTask

AGAIN = "the result stands; the same command makes it again"


def best_weights(task: SupervisedTask, folder: RunFolder) -> int:
    """Load those of the best epoch of this run; the epoch.

    Raises:
        UserError: they are damaged, or of another run.
    """
    path = folder.path / BEST
    try:
        content = read_checkpoint(path)
    except DamagedError as error:
        raise UserError(
            f"the best epoch's weights are damaged, and the same command finds them anew: {error}"
        ) from None
    folder.check_best(content)
    return build.fill(task, content, path)


def decorate(
    folder: RunFolder,
    results: Results,
    summary: Mapping[str, Any],
    task: SupervisedTask,
    loggers: Sequence[Logger],
    wanted: Sequence[str] = DECORATIONS,
) -> Mapping[str, Any]:
    """Make what is wanted, once the result is written; what fails is said, and left to be made again.

    Every process of a training draws the frames that it has seen, and the first one does all the rest.

    Returns:
        The summary, with the cost.
    """
    made = Decorations(AGAIN)
    if "panels" in wanted:
        if is_first():
            with made.one("panels"):
                results.panels.clear()
        task.trainer.strategy.barrier()
        with made.one("panels"):
            results.panels.draw()
        task.trainer.strategy.barrier()
    if not is_first():
        return summary
    if "cost" in wanted:
        with made.one("cost"):
            height, width = folder.options.data.size
            summary = {**summary, "cost": measure_cost(task.network, (height, width))}
            write_json(folder.path / SUMMARY, summary)
    for logger in loggers:
        with made.one(type(logger).__name__):
            results.log(logger, summary)
    with made.one(PAGE):
        write_run_page(folder.path)
    folder.decorated(made.but(DECORATIONS))
    return summary


def show_again(options: TrainOptions, folder: RunFolder) -> None:
    """The table of a finished run, what is not as it was since, and what its decorations lacked."""
    if summary := read_plain(folder.path / SUMMARY):
        print_summary(summary)
    say_changes(folder.starts.changes(this_start(options)), "this run's last start")
    try:
        folder.check_best(read_checkpoint(folder.path / BEST))
    except (OSError, DamagedError, UserError) as error:
        print(f"note: {error}", flush=True)
    if undone := folder.undone:
        made = Decorations(AGAIN)
        with made.one(", ".join(undone)):
            _made_again(options, folder, undone)
    print(f"finished before: {folder.path}; overwrite=true trains again", flush=True)


def _made_again(options: TrainOptions, folder: RunFolder, undone: Sequence[str]) -> None:
    """Decorations of a run that is finished; its numbers stay."""
    folder.owned.adopt(*FILES)
    summary = read_plain(folder.path / SUMMARY)
    seed_everything(options.seed, workers=True, verbose=False)
    name, protocol = options.one_protocol
    data = data_module(options.data, options.phantom, options.seed, ["test"], protocol.truth)
    task = build.task(options)
    best_weights(task, folder)
    scored = Scored.after(options.data, "test")
    facts = facts_of(options.model.name, options.seed, scored, name)
    results = Results(facts, folder.path, KIND, scored, data.lengths(), options.callbacks.panels)
    alone = options.trainer.model_copy(update={"devices": 1, "num_nodes": 1, "strategy": "auto"})
    kept = kept_predictions(options, folder.path) if PREDICTIONS in undone else []
    trainer = make_trainer(alone, [results.panels, *kept], [])
    trainer.test(task, datamodule=data, verbose=False)
    decorate(folder, results, summary, task, [], [name for name in undone if name in DECORATIONS])


def kept_predictions(options: TrainOptions, folder: Path) -> list[Callback]:
    """What keeps the predictions of the test, where they are asked for."""
    if not options.callbacks.predictions:
        return []
    facts = {"max_depth": options.model.max_depth, "split": "test"}
    return [SavePredictions(folder / PREDICTIONS, facts)]

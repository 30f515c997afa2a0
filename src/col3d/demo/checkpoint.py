"""Which network the page shows when nobody says."""

from pathlib import Path

from col3d.app.run_folder import CHECKPOINTS
from col3d.checks import UserError
from col3d.reports.jobs import RESULT


def newest_checkpoint(runs: Path) -> Path:
    """The best checkpoint of the run that finished last.

    Args:
        runs: a folder of runs and of sweeps.

    Raises:
        UserError: no run below it has finished.
    """
    marks = sorted(runs.rglob(RESULT), key=lambda path: path.stat().st_mtime, reverse=True)
    for mark in marks:
        checkpoint = mark.parent / CHECKPOINTS / "best.ckpt"
        if checkpoint.is_file():
            return checkpoint
    raise UserError(f"checkpoint: no run below {runs}/ has finished; say make train, or give checkpoint=PATH")

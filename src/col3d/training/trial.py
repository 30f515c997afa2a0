"""Trial run (`fast_dev_run`): train on a few batches in a temporary folder to see whether everything runs."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from col3d.runs.rank import is_first
from col3d.training.options import TrainOptions

FOLDER = "COL3D_FAST_DEV_RUN"
"""Environment variable with the temporary folder, shared by the processes of one training."""

WENT_THROUGH = "batch(es) of training, validation and test went through; nothing is kept"


@contextmanager
def trial(options: TrainOptions) -> Iterator[TrainOptions]:
    """Yield the options of a trial run: a few batches of everything, no loggers, a temporary folder.

    Nothing is written into the folder of the run, so that a trial cannot be mistaken for a run.
    """
    inherited = os.environ.get(FOLDER)
    place = Path(inherited or tempfile.mkdtemp(prefix="col3d_"))
    os.environ[FOLDER] = str(place)
    changes = {"output_dir": str(place / "run"), "trainer": options.trainer.tried(), "logger": {}}
    try:
        yield options.model_copy(update={**changes, "overwrite": False})
        if is_first():
            print(f"fast_dev_run: {int(options.trainer.fast_dev_run or 1)} {WENT_THROUGH}", flush=True)
    finally:
        os.environ.pop(FOLDER, None)
        if inherited is None:
            shutil.rmtree(place, ignore_errors=True)
        with suppress(OSError):  # it is not empty, or does not exist
            Path(options.output_dir).rmdir()

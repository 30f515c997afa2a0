"""The command line of a job, with which Lightning starts further processes of the same training."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import read_write

from col3d.cli.paths import quoted_again

PROCESSES = ("LOCAL_RANK", "NODE_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""Environment variables that Lightning sets for its other processes, and that its next Trainer would read."""
POLL_SECONDS = 1.0


class Again:
    """The command with which another process of the same program is started.

    Args:
        argv: `sys.argv` of this process, before it was changed.
        name: name of the program; added after the command unless argv[0] is the program's own script.
    """

    def __init__(self, argv: Sequence[str], name: str) -> None:
        script = Path(argv[0]).absolute()
        self.command = [str(script), *([] if script.name == f"{name}.py" else [name])]

    @contextmanager
    def as_single_job(self) -> Iterator[None]:
        """Make `sys.argv` in the block the command of this job alone, even if it is a job of a sweep.

        The environment variables in `PROCESSES` are restored after the block.
        """
        hydra = HydraConfig.get()
        if str(hydra.launcher._target_).endswith(".JoblibLauncher"):
            threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
        arguments, folder = sys.argv, hydra.runtime.output_dir
        before = {name: os.environ.get(name) for name in PROCESSES}
        given = arguments[1:]
        if hydra.mode == RunMode.MULTIRUN:
            given = [*quoted_again(hydra.overrides.task), "hydra.mode=RUN", f"hydra.run.dir={folder}"]
            with read_write(hydra.run):  # type: ignore[arg-type]
                hydra.run.dir = folder
        sys.argv = [*self.command, *given]
        try:
            yield
        finally:
            sys.argv = arguments
            for name, value in before.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value


def _end_with(launcher: int) -> None:
    """Send SIGTERM to this job when the process that launched it is gone: joblib's workers outlive it."""
    while os.getppid() == launcher:
        time.sleep(POLL_SECONDS)
    os.kill(os.getpid(), signal.SIGTERM)

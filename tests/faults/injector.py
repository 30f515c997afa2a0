"""A process that has imported everything and forks commands, in each of which a call to the system fails.

As a program it reads a JSON object from each line of its input, and answers with the exit code and how many
calls of each kind the command made below the folder.
"""

import ctypes
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tests.faults.training import PROJECT, NotMadeError

KINDS = ("write", "rename", "fsync", "read")
SOURCE = Path(__file__).with_name("inject.c")


class Injector:
    """Runs commands with faults, one at a time.

    Args:
        place: for the library that makes the faults, and the log.

    Raises:
        NotMadeError: it cannot be built here.
    """

    def __init__(self, place: Path) -> None:
        compiler = shutil.which(os.environ.get("CC", "cc"))
        if sys.platform != "linux" or compiler is None:
            raise NotMadeError("needs Linux and a C compiler")
        library, self.log = place / "inject.so", place / "log.txt"
        subprocess.run([compiler, "-shared", "-fPIC", "-O2", "-o", library, SOURCE, "-ldl"], check=True)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.injector", str(self.log)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=PROJECT,
            env={**os.environ, "OMP_NUM_THREADS": "1", "LD_PRELOAD": str(library)},
        )

    def run(
        self, command: str, given: Any, root: Path, kind: str = "write", n: int = 0, stays: bool = False
    ) -> tuple[int, dict[str, int], str]:
        """Run a command whose n-th call of a kind below a folder fails, and all after it where it `stays`.

        Returns:
            Its exit code, how many calls of each kind it made, and what it printed.
        """
        self.log.write_text("")
        asked = {"command": command, "given": given, "root": str(root), "kind": kind, "n": n, "stays": stays}
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        return answer["code"], answer["calls"], self.log.read_text(errors="replace")

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()


def _commands() -> Mapping[str, Callable[[Any], Any]]:
    from col3d.data.cache.prepare import prepare
    from col3d.evaluation.evaluate import evaluate
    from col3d.inference.export.export import export
    from col3d.inference.fusion.fuse import fuse
    from col3d.inference.predict import predict
    from col3d.reports import figures, run_page
    from col3d.reports.__main__ import main
    from col3d.training.train import train

    if find_spec("open3d"):
        import_module("open3d")
    assert figures.DRAW
    assert run_page.PAGE
    return {
        "train": train,
        "evaluate": evaluate,
        "predict": predict,
        "export": export,
        "fuse": fuse,
        "prepare": prepare,
        "report": lambda given: sys.exit(main(given)),
    }


def _serve(log: Path) -> None:
    commands = _commands()
    faults = ctypes.CDLL(None)
    for line in sys.stdin:
        asked = json.loads(line)
        reader, writer = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(reader)
            _run_alone(commands[asked["command"]], asked, faults, writer, log)
        os.close(writer)
        with os.fdopen(reader) as told:
            calls = json.loads(told.read() or "{}")
        _, status = os.waitpid(process, 0)
        print(json.dumps({"code": os.waitstatus_to_exitcode(status), "calls": calls}), flush=True)


def _run_alone(
    command: Callable[[Any], Any], asked: Mapping[str, Any], faults: ctypes.CDLL, writer: int, log: Path
) -> None:
    from col3d.cli.program import BAD_INPUT
    from col3d.cli.refusals import explain

    out = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(out, 1)
    os.dup2(out, 2)
    code, root, kind = 1, asked["root"].encode() + b"/", KINDS.index(asked["kind"])
    faults.faults_arm(root, kind, ctypes.c_long(asked["n"]), int(asked["stays"]))
    try:
        command(asked["given"])
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    except BAD_INPUT as error:
        code = 2
        print(f"error: {explain(error, asked['command'])}")
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os.write(writer, json.dumps({k: faults.faults_count(i) for i, k in enumerate(KINDS)}).encode())
        os._exit(code)


def main(arguments: Sequence[str]) -> None:
    """Serve until the input ends."""
    _serve(Path(arguments[0]))


if __name__ == "__main__":
    main(sys.argv[1:])

"""Where a result comes from: the command that made it, and the version of the code."""

import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("col3d", "torch", "lightning", "torchmetrics", "timm", "kornia", "numpy")


def command() -> str:
    """This process's command line, as one types it."""
    return f"python {shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])}"


def commit() -> str | None:
    """The commit of the code, with -dirty where files differ from it; None outside a repository."""
    here = Path(__file__).parent
    try:
        answer = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=here,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return answer.stdout.strip()


def versions() -> dict[str, str]:
    """Of the packages that numbers depend on."""
    return {name: version(name) for name in PACKAGES}


def provenance() -> dict[str, object]:
    """All of it."""
    return {"command": command(), "commit": commit(), "versions": versions()}

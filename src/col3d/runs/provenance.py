"""Where a result comes from: the command that made it, and the version of the code."""

import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import distribution, entry_points, packages_distributions, version
from pathlib import Path

from col3d.registry.plugins import code_sum as package_sum

PACKAGES = ("col3d", "torch", "lightning", "torchmetrics", "timm", "kornia", "numpy")


def command(words: Sequence[str] | None = None) -> str:
    """A command line as one types it: this process's, when absent."""
    script, *arguments = sys.argv if words is None else words
    name = Path(script).name
    program = {"__main__.py": ["python", "-m", "col3d"]}.get(name, ["python", name])
    return shlex.join([*(program if name.endswith(".py") else [name]), *arguments])


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


def plugins() -> dict[str, str]:
    """Packages that Hydra or Lightning find by themselves, and those that say they extend this one."""
    groups = [group for group in entry_points().groups if group.startswith(("col3d", "lightning", "hydra"))]
    offering = (point.dist for group in groups for point in entry_points(group=group))
    found = {dist.name: dist.version for dist in offering if dist is not None}
    hydra = packages_distributions().get("hydra_plugins", [])
    return found | {name: distribution(name).version for name in hydra}


def code_sum() -> str:
    """Of all files of this package that can be run, committed or not."""
    return package_sum(Path(__file__).parents[1])


def provenance() -> dict[str, object]:
    """All of it."""
    return {"command": command(), "commit": commit(), "versions": versions()}

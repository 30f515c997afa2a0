"""Provenance of a result: the command that made it, and the versions of code and packages."""

import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import distribution, entry_points, packages_distributions, version
from pathlib import Path

from col3d.registry.plugins import code_sum as package_sum

PACKAGES = ("col3d", "torch", "lightning", "torchmetrics", "timm", "kornia", "numpy")


def command(words: Sequence[str] | None = None) -> str:
    """Format a command line as one types it; by default that of this process."""
    script, *arguments = sys.argv if words is None else words
    name = Path(script).name
    program = {"__main__.py": ["python", "-m", "col3d"]}.get(name, ["python", name])
    return shlex.join([*(program if name.endswith(".py") else [name]), *arguments])


def commit() -> str | None:
    """Return the commit of the code, with -dirty if files differ from it; None outside a repository."""
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
    """Return the versions of the packages that numbers depend on."""
    return {name: version(name) for name in PACKAGES}


def plugins() -> dict[str, str]:
    """Return the versions of installed packages that extend Hydra, Lightning or this package."""
    groups = [group for group in entry_points().groups if group.startswith(("col3d", "lightning", "hydra"))]
    offering = (point.dist for group in groups for point in entry_points(group=group))
    packages = {dist.name: dist.version for dist in offering if dist is not None}
    hydra = packages_distributions().get("hydra_plugins", [])
    return packages | {name: distribution(name).version for name in hydra}


def code_sum() -> str:
    """Compute the checksum of all Python files of this package, committed or not."""
    return package_sum(Path(__file__).parents[1])


def provenance() -> dict[str, object]:
    """Return the command, the commit and the versions."""
    return {"command": command(), "commit": commit(), "versions": versions()}

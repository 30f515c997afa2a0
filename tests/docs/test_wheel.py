"""The wheel holds all that the package reads, and works where the project is not."""

import importlib.util
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]
IMPORT_ALL = """
import pkgutil, sys, col3d
names = [module.name for module in pkgutil.walk_packages(col3d.__path__, "col3d.")]
for name in names:
    if not name.endswith("__main__"):
        __import__(name)
from col3d.data.videos import video_table
from col3d.reports.paper_tables import *
print(col3d.__file__, len(names), len(video_table()))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made of a copy, for a build leaves folders beside what it builds."""
    source = tmp_path_factory.mktemp("wheel")
    for path in PROJECT.iterdir():
        if path.is_file() and path.suffix in ("", ".md", ".toml"):
            shutil.copy(path, source)
    shutil.copytree(
        PROJECT / "src", source / "src", ignore=shutil.ignore_patterns("*.egg-info", "__pycache__")
    )
    alone = [] if importlib.util.find_spec("setuptools") is None else ["--no-isolation"]
    command = [sys.executable, "-m", "build", "--wheel", *alone, str(source)]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return next((source / "dist").glob("*.whl"))


def test_it_holds_every_file_of_the_package(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    source = PROJECT / "src"
    files = (path for path in (source / "col3d").rglob("*") if path.is_file())
    wanted = {path.relative_to(source).as_posix() for path in files if path.suffix != ".pyc"}
    assert {"col3d/py.typed", "col3d/data/videos.csv", "col3d/reports/templates/report.html.j2"} <= wanted
    assert not wanted - held
    assert any(name.endswith("dist-info/licenses/LICENSE") for name in held)


def test_it_works_in_an_environment_without_the_project(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "environment"
    venv.create(home)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", str(wheel)], check=True)
    site = next((home / "lib").glob("python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    answer = subprocess.run(
        [str(python), "-c", IMPORT_ALL], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr
    file, modules, videos = answer.stdout.split()[-3:]
    assert Path(file).is_relative_to(site)
    assert (int(modules) > 150, int(videos)) == (True, 22)

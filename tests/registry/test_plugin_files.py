"""Where plugins lie, whichever form their code has, and the sums over their files."""

from pathlib import Path

import pytest
from refusals import refused

from col3d.errors import OptionError
from col3d.registry import plugins


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(plugins, "loaded", {})
    monkeypatch.setenv(plugins.VARIABLE, "")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "unrelated.py").write_text("")
    (tmp_path / "conf").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("as_package/__init__.py", "as_package"),
        ("as_folder/parts.py", "as_folder"),
        ("as_file.py", "as_file"),
        ("in_folder/parts.py", "in_folder.parts"),
    ],
)
def test_the_sum_is_of_the_plugin_s_own_files(folder: Path, file: str, name: str) -> None:
    (folder / file).parent.mkdir(exist_ok=True)
    (folder / file).write_text("")
    plugins.load([name])
    before = plugins.code()
    (folder / "unrelated.py").write_text("# another line")
    assert plugins.code() == before
    assert plugins.configurations() == []
    (folder / file).write_text("# another line")
    assert plugins.code().keys() == {name}
    assert plugins.code() != before


def test_the_lock_of_an_editor_is_no_file(folder: Path) -> None:
    (folder / "edited").mkdir()
    (folder / "edited" / "__init__.py").write_text("")
    plugins.load(["edited"])
    before = plugins.code()
    (folder / "edited" / ".#net.py").symlink_to("someone@host.1234")
    assert plugins.code() == before


@pytest.mark.parametrize("name", ["random", "os", "json.decoder"])
def test_a_package_named_as_one_of_python_s_is_refused(folder: Path, name: str) -> None:
    with refused(OptionError, "plugins", name.partition(".")[0], "Python"):
        plugins.load([name])

"""Files beside the code say what the code's metadata says."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

PROJECT = Path(__file__).parents[2]
METADATA = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (PROJECT / "Makefile").read_text(encoding="utf-8")
WORKFLOWS = sorted((PROJECT / ".github" / "workflows").glob("*.yml"))


def test_the_notices_list_what_is_depended_on() -> None:
    notices = (PROJECT / "THIRD_PARTY_NOTICES.md").read_text(encoding="utf-8")
    extras = METADATA["optional-dependencies"]
    asked = [("", entry) for entry in METADATA["dependencies"]]
    asked += [(f"`{extra}` | ", entry) for extra, entries in extras.items() for entry in entries]
    rows = {f"| {extra}{name} |" for extra, entry in asked for name in re.findall(r"^[\w-]+", entry)}
    listed = set(re.findall(r"^\| (?:`\w+` \| )?[\w-]+ \|", notices, flags=re.MULTILINE))
    listed -= {"| needed |", "| extra |", "| C3VDv2 |", "| SimCol3D |"}
    assert {row for row in rows if "| col3d |" not in row} == listed


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((PROJECT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (METADATA["version"], METADATA["license"])
    assert citation["references"][0]["url"] == METADATA["urls"]["Paper"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_targets_that_exist(path: Path) -> None:
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    commands = "\n".join(step.get("run", "") for job in jobs.values() for step in job["steps"])
    targets = re.findall(r"^make ([\w-]+)", commands, flags=re.MULTILINE)
    assert targets
    for target in targets:
        assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE), target


def test_hooks_run_programs_of_the_environment() -> None:
    hooks = yaml.safe_load((PROJECT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert [source["repo"] for source in hooks] == ["local"]
    entries = " ".join(hook["entry"] for hook in hooks[0]["hooks"])
    for program in ("ruff check", "ruff format", "mypy", "lint-imports"):
        assert f".venv/bin/{program}" in entries

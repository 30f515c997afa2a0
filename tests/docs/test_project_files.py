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


def locked(name: str) -> dict[str, str]:
    """Versions by name, of a file in which each has hashes."""
    text = (PROJECT / "locks" / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", "")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    found = [re.fullmatch(r"([\w.-]+)==(\S+)((?: +--hash=sha256:[0-9a-f]{64})+) *", line) for line in lines]
    assert all(found), next(line for line, match in zip(lines, found, strict=True) if not match)
    return {canonical(match[1]): match[2] for match in found if match}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_package_is_locked_by_hashes() -> None:
    constraints = (PROJECT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in constraints if not line.startswith("#")]
    versions = {canonical(name): version for name, version in pairs}
    dev, train, build = (locked(name) for name in ("dev", "train", "build"))
    assert dev == versions | build
    assert train.items() <= dev.items()
    needed = [canonical(re.split(r"[<>=!\[]", entry)[0]) for entry in METADATA["dependencies"]]
    assert set(needed) | {"setuptools"} <= set(train)


def test_actions_are_pinned_by_commit() -> None:
    for path in WORKFLOWS:
        for action in re.findall(r"uses: (.*)", path.read_text(encoding="utf-8")):
            assert re.fullmatch(r"[\w/-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", action), action


def test_the_container_runs_as_a_user_and_installs_by_hashes() -> None:
    lines = (PROJECT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    before = lines[: next(place for place, line in enumerate(lines) if line.startswith("ENTRYPOINT"))]
    assert [line for line in before if line.startswith("USER ")][-1:] not in ([], ["USER root"])
    ours = "--no-deps --no-build-isolation -e ."
    installs = [line for line in lines if "pip install" in line]
    assert all("--require-hashes" in line or ours in line for line in installs)
    copied = {word for line in lines if line.startswith("COPY ") for word in line.split()[1:-1]}
    kept = (PROJECT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert {f"!{word}" for word in copied} <= set(kept)


def test_no_second_index_is_mixed_in() -> None:
    for path in (*WORKFLOWS, PROJECT / "Dockerfile", PROJECT / "README.md", PROJECT / "Makefile"):
        for line in path.read_text(encoding="utf-8").splitlines():
            assert "--extra-index-url" not in line
            assert "EXTRA_INDEX_URL" not in line or "PIP_EXTRA_INDEX_URL= " in line

"""The pages build strictly, ask nothing of the network, and document every public module."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.end_to_end

PROJECT = Path(__file__).parents[2]
SOURCE = PROJECT / "src"
PUBLIC = ("geometry", "models", "losses", "metrics", "data", "fusion", "reports")
REMOTE = [
    r"<script[^>]*\ssrc=[\"'](?:https?:)?//[^>]*",
    r"<link[^>]*\shref=[\"'](?:https?:)?//[^>]*",
    r"<(?:img|iframe|source|video|embed)[^>]*\ssrc=[\"'](?:https?:)?//[^>]*",
    r"url\(\s*[\"']?(?:https?:)?//[^)]*",
    r"@import[^;]*",
]
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("docs")
    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(out / "trees")]
    command = [sys.executable, "-m", "sphinx", *options, str(PROJECT / "docs"), str(out / "html")]
    answer = subprocess.run(command, capture_output=True, text=True, check=False, cwd=out)
    assert answer.returncode == 0, answer.stderr
    return out / "html"


def test_no_page_asks_the_network_for_anything(built: Path) -> None:
    pages = list(built.rglob("*.html"))
    assert len(pages) > 15
    for path in [*pages, *built.rglob("*.css")]:
        text = path.read_text(encoding="utf-8")
        assert [re.findall(pattern, text) for pattern in REMOTE] == [[]] * len(REMOTE), path
    for path in built.rglob("*.js"):
        assert not re.search(r"googleapis|jsdelivr|unpkg|cdnjs|polyfill\.io", path.read_text()), path


def test_every_public_module_is_in_the_api(built: Path) -> None:
    api = "".join(path.read_text(encoding="utf-8") for path in (built / "api").glob("*.html"))
    documented = set(re.findall(r'id="module-(col3d[\w.]*)"', api))
    files = (file for package in PUBLIC for file in (SOURCE / "col3d" / package).rglob("*.py"))
    modules = {
        ".".join(file.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")
        for file in files
        if file.stem != "__main__"
    }
    assert len(modules) > 100
    assert not modules - documented


def test_signatures_read_as_they_are_written(built: Path) -> None:
    page = (built / "api" / "losses.html").read_text(encoding="utf-8")
    shown = re.sub(r"<[^>]*>", "", page).replace("&#39;", "'")
    assert "preds: Float[Tensor, 'b 1 h w']" in shown
    for path in (built / "api").glob("*.html"):
        shown = re.sub(r"<[^>]*>", "", path.read_text(encoding="utf-8"))
        assert not re.findall(r"jaxtyping\.\w+\[|~\w+|0x[0-9a-f]{6,}|&lt;(?:factory|function)", shown), path


def test_constants_have_the_whole_of_their_docstrings(built: Path) -> None:
    page = (built / "api.html").read_text(encoding="utf-8")
    assert "True where depth is known: only these pixels count." in page
    assert not [path for path in built.rglob("*.html") if re.search(r">Type<|\ue000", path.read_text())]


def links() -> Iterator[tuple[Path, str]]:
    """Relative links of the pages at the root, which Sphinx does not check."""
    for name in ("README", "CONTRIBUTING", "CHANGELOG", "THIRD_PARTY_NOTICES"):
        page = PROJECT / f"{name}.md"
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                yield page, target


@pytest.mark.parametrize(("page", "target"), list(links()), ids=lambda value: getattr(value, "stem", value))
def test_links_of_root_pages_lead_somewhere(page: Path, target: str) -> None:
    file, _, anchor = target.partition("#")
    text = (page.parent / file).read_bytes().decode(errors="replace")
    slugs = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in HEADING.findall(text)]
    assert not anchor or anchor in slugs

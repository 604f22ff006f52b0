"""The whole site: it builds without a warning, every link arrives, nothing is loaded from elsewhere, search finds."""

import asyncio
import json
import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from sphinx.util.inventory import InventoryFile

from aerial_il.cli import reference
from aerial_il.presentation.documentation.site import SiteError, build
from aerial_il.presentation.documentation.sources import FILMS, NoSourcesError, assemble, site_files
from tests.presentation.documentation.public_names import public_names
from tests.teleop.chromium import browser, needs_browser

LOADING = {
    **dict.fromkeys(("script", "img", "video", "source", "iframe"), "src"),
    "link": "href",
    "object": "data",
}
HARMLESS = {"canonical", "search", "prev", "next", "index", "genindex", "author", "help", "license"}  # load nothing
FETCHED = re.compile(r"(?:url\(|@import)\s*[\"']?https?:[^)\"']+")  # in a style sheet


class Page(HTMLParser):
    """Anchors, links and what is loaded, of one page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loads = set[str](), list[str](), list[str]()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = {key: value or "" for key, value in attrs}
        self.anchors |= {told[key] for key in ("id", "name") if key in told}
        if tag == "a" and "href" in told:
            self.links.append(told["href"])
        if tag in LOADING and LOADING[tag] in told and told.get("rel") not in HARMLESS:
            self.loads.append(told[LOADING[tag]])
        if "poster" in told:
            self.loads.append(told["poster"])


def leaves(target: str) -> bool:
    """Whether a target lies outside the site."""
    return bool(re.match(r"[a-z]+:|//", target))


def faults(site: Path) -> list[str]:
    """Return what a site loads from elsewhere, and the links within it that do not arrive."""
    read = cache(Page)
    wrong = []
    for file in sorted(site.rglob("*.html")):
        page = read(file)
        wrong += [f"{file.name}: loads {each}" for each in page.loads if leaves(each) and not each.startswith("data:")]
        for target in (each for each in (*page.links, *page.loads) if not leaves(each)):
            parts = urlsplit(target)
            other = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment) if other.suffix == ".html" else ""
            if not other.is_file() or (anchor and anchor not in read(other).anchors):
                wrong.append(f"{file.relative_to(site)}: {target}")
    return wrong


def external(site: Path) -> list[str]:
    """Return what style sheets fetch from elsewhere."""
    sheets = [(file.name, file.read_text(encoding="utf-8", errors="replace")) for file in site.rglob("*.css")]
    return [f"{name}: {fetched}" for name, text in sheets for fetched in FETCHED.findall(text)]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("documentation") / "site", reference.pages(), quiet=True).parent


@pytest.mark.slow
def test_every_link_arrives_and_nothing_comes_from_elsewhere(site: Path) -> None:
    assert faults(site) == []
    assert external(site) == []


@pytest.mark.slow
def test_every_public_name_is_there(site: Path) -> None:
    with (site / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda *parts: "/".join(parts))
    there = {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}
    assert sorted(public_names() - there) == []


@pytest.mark.slow
def test_every_page_and_every_command_is_there(site: Path) -> None:
    for _, place in site_files():
        expected = place if place.endswith((*FILMS, ".cff")) else f"{place.rpartition('.')[0]}.html"
        assert (site / expected).is_file() or place.endswith((".svg", ".png", ".webp")), place
    assert all((site / f"{page.removesuffix('.md')}.html").is_file() for page in reference.pages())


@pytest.mark.slow
@pytest.mark.browser
@needs_browser
def test_search_finds_from_the_disk_alone(site: Path) -> None:
    async def results() -> list[str]:
        async with browser() as open_page:
            tab = await open_page(f"{(site / 'search.html').as_uri()}?q=turbulence")
            await tab.until("document.querySelectorAll('#search-results li').length > 1")
            assert tab.errors == []
            return await tab.value("[...document.querySelectorAll('#search-results li')].map(e => e.innerText)")

    assert any("Models of wind" in line for line in asyncio.run(results()))


def test_what_does_not_arrive_is_found(tmp_path: Path) -> None:
    (tmp_path / "b.html").write_text('<p id="here">x</p>')
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here"></a><a href="b.html#gone"></a><a href="c.html"></a><a href="https://example.org"></a>'
        '<script src="https://cdn.example.org/x.js"></script><img src="no.png">'
        '<link rel="stylesheet" href="//x.org/a.css">'
    )
    (tmp_path / "a.css").write_text("@import 'https://fonts.example.org/a.css'; b { background: url(//ok) }")
    wrong = faults(tmp_path)
    assert [line.rpartition(" ")[2] for line in wrong] == [
        "https://cdn.example.org/x.js", "//x.org/a.css", "b.html#gone", "c.html", "no.png",
    ]  # fmt: skip
    assert len(external(tmp_path)) == 1


def test_without_a_checkout_it_says_where_the_pages_are(tmp_path: Path) -> None:
    with pytest.raises(NoSourcesError, match="Clone the repository and run there: make docs"):
        assemble(tmp_path / "work", {}, root=tmp_path)


def test_without_its_generator_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aerial_il.presentation.documentation.site.NEEDED", ("sphinx", "no_such_generator"))
    with pytest.raises(SiteError, match=r"needs no_such_generator: pip install 'aerial-il\[docs\]'"):
        build(tmp_path / "site", {})


def test_laid_out_sources_are_those_of_the_repository(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    (tmp_path / "source" / "stale.md").write_text("# gone")
    assemble(tmp_path, {"commands/index.md": "# Commands", "commands/fly.md": "# fly"})
    start = (tmp_path / "source" / "index.md").read_text(encoding="utf-8")
    assert not (tmp_path / "source" / "stale.md").exists()
    assert ":caption: Reference\n\nrobots/index.md" in start
    assert "commands/index.md" in start
    assert "fly.md" in (tmp_path / "source" / "commands" / "index.md").read_text(encoding="utf-8")
    assert (tmp_path / "copied" / "tasks" / "reach.mp4").is_file()


def test_a_page_that_is_as_it_was_keeps_its_time(tmp_path: Path) -> None:
    assert assemble(tmp_path, {}), "all its pages are new"
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.md")}
    assert not assemble(tmp_path, {})
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.md")} == before


def test_another_title_is_seen(tmp_path: Path) -> None:
    page = "python/index.md"
    assemble(tmp_path, {page: "# One\n\ntext"})
    assert not assemble(tmp_path, {page: "# One\n\nother text"})
    assert assemble(tmp_path, {page: "# Two\n\nother text"})


@pytest.mark.parametrize("folder", ["notebooks", "notebooks/zh"])
def test_links_of_a_notebook_lead_to_the_pages(folder: str, tmp_path: Path) -> None:
    root, up = tmp_path / "repository", "../" * len(folder.split("/"))
    (root / "docs").mkdir(parents=True)
    (root / folder).mkdir(parents=True)
    for name in ("docs/index.md", "docs/tiers.md", "CONTRIBUTING.md", "CHANGELOG.md", "CITATION.cff"):
        (root / name).write_text("# a page\n\n## Notebooks\n")
    cells = [
        {"cell_type": "markdown", "metadata": {}, "source": ["# Air\n", f"see [tiers]({up}docs/tiers.md)"]},
        {"cell_type": "code", "metadata": {}, "source": "'[tiers](../docs/tiers.md)'", "outputs": []},
    ]
    (root / folder / "air.ipynb").write_text(json.dumps({"cells": cells, "metadata": {}, "nbformat": 4}))
    assemble(tmp_path / "work", {}, root=root)
    laid = json.loads((tmp_path / "work" / "source" / folder / "air.ipynb").read_text())
    assert laid["cells"][0]["source"] == f"# Air\nsee [tiers]({up}tiers.md)"
    assert f"\n{folder}/air.ipynb\n" in (tmp_path / "work" / "source" / "index.md").read_text()
    assert laid["cells"][1]["source"] == "'[tiers](../docs/tiers.md)'"

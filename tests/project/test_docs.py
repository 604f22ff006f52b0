"""Pages and docstrings name files that are there: links and paths in Markdown, paths in our code."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)[^)]*\)")
CODE = re.compile(r"`((?:aerial_il|tests|conf|setup|docs|notebooks|experiments)/[\w./-]+\.\w+)`")
SHOWN = re.compile(r"^`([\w./-]+)`\n\n```", re.MULTILINE)  # a file whose content follows, for the reader to write
SAID = re.compile(r"``([\w.-]+(?:/[\w.-]+)+\.(?:py|md|toml|js|html|css))``")  # in a docstring
FORMS = re.compile(r"\b(NAME|GROUP)\b")  # stand for any name
HISTORY = "CHANGELOG.md"  # tells of files that are gone


def pages() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [ROOT / name for name in listed.splitlines()]


def missing(page: Path, text: str) -> list[str]:
    """Return what ``text`` links to or names that is not there."""
    links = [name for name in LINK.findall(text) if not (page.parent / name).exists()]
    named = {*CODE.findall(text)} - {*SHOWN.findall(text)}
    paths = sorted(name for name in named if not re.search(r"\bNAME\b|\bX\b", name) and not (ROOT / name).exists())
    return links + paths


def sources() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "aerial_il/*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.splitlines()]


def gone(text: str) -> list[str]:
    """Return the files that code names, of packages and folders of ours, that are not there."""
    tops = (ROOT, ROOT / "aerial_il", ROOT / "docs")
    ours = {path.name for top in tops for path in top.iterdir() if path.is_dir()}
    named = (name for name in SAID.findall(text) if name.split("/")[0] in ours and not FORMS.search(name))
    return sorted(name for name in named if not any((top / name).exists() for top in tops))


def test_what_docstrings_name_is_there() -> None:
    lost = {str(file.relative_to(ROOT)): result for file in sources() if (result := gone(file.read_text("utf-8")))}
    assert lost == {}


def test_a_docstring_that_names_what_is_gone_is_found() -> None:
    text = "``suite/gone.py``, ``aerial_il/gone.py``, ``suite/batch.py``, ``docs/tiers.md``, ``robots/NAME.md``"
    text += ", ``d4rl/elsewhere.py``"
    assert gone(text) == ["aerial_il/gone.py", "suite/gone.py"]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there(page: Path) -> None:
    if page.name != HISTORY:
        assert missing(page, page.read_text(encoding="utf-8")) == []


def test_what_is_not_there_is_found() -> None:
    there = "[b](https://example.org/x.md) `aerial_il/robots/NAME.py` `aerial_il/__init__.py`"
    shown = "`aerial_il/new.py`\n\n```python\npass\n```"
    text = f"[a](nowhere.md) `aerial_il/gone.py` {there}\n\n{shown}\n"
    assert missing(ROOT / "README.md", text) == ["nowhere.md", "aerial_il/gone.py"]


def test_every_page_is_listed_where_readers_begin() -> None:
    """Or in the overview of its own folder, such as those of the robots and the tasks."""
    docs = ROOT / "docs"
    start = (docs / "index.md").read_text(encoding="utf-8")
    lost = [page.name for page in docs.glob("*.md") if page.name != "index.md" and f"({page.name})" not in start]
    assert lost == [], "name them in docs/index.md, under the heading of their kind"


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.name)
def test_a_page_is_read_in_one_sitting(page: Path) -> None:
    """At most 1,500 words beside its code: longer ones are split by topic."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert sum(any(letter.isalnum() for letter in word) for word in prose.split()) <= 1500

"""Pages name files that are there: links and paths in all Markdown."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)[^)]*\)")
CODE = re.compile(r"`((?:aerial_il|tests|conf|setup|docs|notebooks|experiments)/[\w./-]+\.\w+)`")
SHOWN = re.compile(r"^`([\w./-]+)`\n\n```", re.MULTILINE)  # a file whose content follows, for the reader to write
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


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_is_there(page: Path) -> None:
    if page.name != HISTORY:
        assert missing(page, page.read_text(encoding="utf-8")) == []


def test_what_is_not_there_is_found() -> None:
    there = "[b](https://example.org/x.md) `aerial_il/robots/NAME.py` `aerial_il/__init__.py`"
    shown = "`aerial_il/new.py`\n\n```python\npass\n```"
    text = f"[a](nowhere.md) `aerial_il/gone.py` {there}\n\n{shown}\n"
    assert missing(ROOT / "README.md", text) == ["nowhere.md", "aerial_il/gone.py"]

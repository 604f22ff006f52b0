"""Formulas become MathML, all of those on the pages too, and what cannot be written is an error."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from math_core import LatexError

from aerial_il.presentation.documentation.mathml import to_mathml

DOCS = Path(__file__).resolve().parents[3] / "docs"
BLOCK, INLINE = re.compile(r"\$\$(.+?)\$\$", re.DOTALL), re.compile(r"(?<![$\\`(])\$([^$`\n(][^$`\n]*)\$(?!\$)")


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_every_formula_of_a_page_is_written(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for tex in BLOCK.findall(text):
        assert to_mathml(tex, block=True).startswith("<math")
    for tex in INLINE.findall(BLOCK.sub("", text)):
        assert to_mathml(tex).startswith("<math")


def test_a_subscript_stands_below_the_hat() -> None:
    """An accent covers its letter alone, and the subscript belongs to both."""
    sub = ET.fromstring(to_mathml(r"\hat p_k")).find("msub")
    assert sub is not None
    assert [part.tag for part in sub] == ["mover", "mi"]
    assert [part.text for part in sub[0]] == ["p", "\N{MODIFIER LETTER CIRCUMFLEX ACCENT}"]
    assert sub[1].text == "k"


def test_lines_are_aligned() -> None:
    table = ET.fromstring(to_mathml(r"a &= b \\ c &= d", block=True)).find("mtable")
    assert table is not None
    assert [[cell.find("mi").text for cell in row] for row in table] == [["a", "b"], ["c", "d"]]  # type: ignore[union-attr]


@pytest.mark.parametrize("tex", [r"\nonsense{x}", r"\frac{1}{2"])
def test_what_is_no_formula_is_refused(tex: str) -> None:
    with pytest.raises(LatexError):
        to_mathml(tex)

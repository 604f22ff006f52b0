"""Formulas become MathML, all of those on the pages too, and what cannot be written is told."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from docutils.utils.math import MathError

from aerial_il.presentation.documentation.mathml import to_mathml

DOCS = Path(__file__).resolve().parents[2] / "docs"
BLOCK, INLINE = re.compile(r"\$\$(.+?)\$\$", re.DOTALL), re.compile(r"(?<![$\\`(])\$([^$`\n(][^$`\n]*)\$(?!\$)")


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_every_formula_of_a_page_is_written(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for tex in BLOCK.findall(text):
        assert to_mathml(tex, block=True).startswith("<math")
    for tex in INLINE.findall(BLOCK.sub("", text)):
        assert to_mathml(tex).startswith("<math")


def test_short_forms_are_understood() -> None:
    assert "<mfrac" in to_mathml(r"\tfrac12 \dots")
    assert "<mtable" in to_mathml(r"a &= b \\ c &= d", block=True)


def test_what_is_no_formula_is_refused() -> None:
    with pytest.raises(MathError):
        to_mathml(r"\nonsense{x}")

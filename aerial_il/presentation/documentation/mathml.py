"""A Sphinx extension that writes formulas as MathML, which browsers draw without a script, a font or a network."""

from __future__ import annotations

import re
from html import escape
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

NAME = "mathml"
SAME = (  # what docutils does not read -> what it does; brackets grow by themselves
    (r"\\dots\b", r"\\ldots"),
    (r"\\([td]?frac)(\d)(\d)", r"\\\1{\2}{\3}"),
    (r"\\[bB]igg?(?![a-zA-Z])", ""),
)
log = logging.getLogger(__name__)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the writer; called by Sphinx."""
    app.add_html_math_renderer(NAME, (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def to_mathml(tex: str, *, block: bool = False) -> str:
    """Return a formula as MathML.

    Args:
        tex: LaTeX, without its dollars. block: on lines of its own, instead of within a sentence.

    Raises:
        MathError: it uses a command that docutils does not know.
    """
    for pattern, replacement in SAME:
        tex = re.sub(pattern, replacement, tex)
    if block and (r"\\" in tex or "&" in tex) and r"\begin" not in tex:
        tex = rf"\begin{{aligned}}{tex}\end{{aligned}}"
    return tex2mathml(tex, as_block=block)


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_written(node, block=False))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{_written(node, block=True)}</div>')
    raise nodes.SkipNode


def _written(node: nodes.math | nodes.math_block, *, block: bool) -> str:
    tex = node.astext()
    try:
        return to_mathml(tex, block=block)
    except MathError as error:
        log.warning("cannot write %r as MathML: %s", tex, error, location=node)
        return f"<code>{escape(tex)}</code>"

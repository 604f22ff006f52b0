"""A Sphinx extension that writes formulas as MathML Core, which browsers draw without a script, a font or a network."""

from html import escape
from typing import Any

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.application import Sphinx
from sphinx.util import logging

NAME = "mathml"
LINES = r"\begin{{aligned}}{}\end{{aligned}}"  # what MyST leaves off a formula of several lines
converter = LatexToMathML(fancy_error=False)
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
        LatexError: an unknown command, or a brace that is not closed.
    """
    if block and r"\begin" not in tex and (r"\\" in tex or "&" in tex):
        tex = LINES.format(tex)
    return converter.convert_with_local_state(tex, displaystyle=block)


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
    except LatexError as error:
        log.warning("cannot write %r as MathML: %s", tex, error, location=node)
        return f"<code>{escape(tex)}</code>"

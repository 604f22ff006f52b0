"""Build the site: lay out its sources, let Sphinx write them as HTML that loads nothing from elsewhere."""

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.errors import AerialError
from aerial_il.presentation.documentation import modules, spaces
from aerial_il.presentation.documentation.sources import COPIED, PAGES, assemble

NEEDED = ("sphinx", "furo", "myst_nb", "sphinx_copybutton", "math_core", "ziamath")
STYLE = Path(__file__).parent / "style"
SETTINGS: dict[str, Any] = {
    "project": "aerial_il",
    "author": "The aerial_il authors",
    "copyright": "the aerial_il authors, Apache-2.0",
    "extensions": [
        *("sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_nb", "sphinx_copybutton"),
        "aerial_il.presentation.documentation.mathml",
    ],
    "root_doc": "index",
    "html_math_renderer": "mathml",
    "html_theme": "furo",
    "html_title": "aerial_il",
    "html_css_files": ["site.css"],
    "html_js_files": ["site.js"],
    "html_copy_source": False,
    "html_show_sourcelink": False,
    "html_show_sphinx": False,
    "html_theme_options": {"navigation_with_keys": True, "top_of_page_buttons": []},
    "myst_enable_extensions": ["dollarmath", "colon_fence"],
    "myst_heading_anchors": 4,
    "nb_execution_mode": "off",
    "nb_ipywidgets_js": {},
    "autodoc_member_order": "bysource",
    "autodoc_inherit_docstrings": False,
    "autodoc_default_options": {"show-inheritance": True},
    "python_use_unqualified_type_names": True,
    "napoleon_use_ivar": True,
    "toc_object_entries": False,  # each page's margin would copy every function of every other
    "copybutton_prompt_text": "$ ",
    # an annotation says `Expert` where several modules have one; which of them is meant, its reader sees at its import
    "suppress_warnings": ["ref.python"],
}


class SiteError(AerialError, RuntimeError):
    """A site that cannot be built, or whose pages are not in order."""


def build(
    out: str | os.PathLike[str], generated: Mapping[str, str], *, strict: bool = True, quiet: bool = False
) -> Path:
    """Build the site and return its first page.

    Args:
        out: folder of the HTML. What Sphinx keeps for the next build lies beside it, in ``<out>.work``.
        generated: path on the site -> text of pages that only a caller above can write.
        strict: warnings are errors. quiet: say nothing of the progress.

    Raises:
        NoSourcesError: this is no checkout.
        SiteError: Sphinx is not installed, or finds something wrong with the pages.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise SiteError(f"The site needs {', '.join(missing)}: pip install 'aerial-il[docs]', or: make setup")
    out, work = Path(out).resolve(), Path(f"{Path(out).resolve()}.work")
    again = assemble(work, {**modules.pages(), **spaces.pages(), **generated})
    problems = _run_sphinx(work, out, again=again, quiet=quiet)
    if problems and strict:
        raise SiteError(f"{len(problems)} problems of the pages:\n" + "\n".join(problems[:40]))
    return out / "index.html"


def _run_sphinx(work: Path, out: Path, *, again: bool, quiet: bool) -> list[str]:
    """Write the HTML and return the warnings, with paths of the laid out sources.

    Args:
        again: write every page, for the titles of all stand in the margin of each; otherwise those that changed.
    """
    import io
    import sys

    from sphinx.application import Sphinx
    from sphinx.util.console import nocolor
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    said, source = io.StringIO(), str(work / PAGES)
    static = [str(STYLE), str(_font())]
    settings = {**SETTINGS, "html_static_path": static, "html_extra_path": [str(work / COPIED)]}
    nocolor()
    with patch_docutils(), docutils_namespace():
        app = Sphinx(
            source, None, str(out), str(work / "doctrees"), "html", settings,
            status=None if quiet else sys.stderr, warning=said, parallel=os.cpu_count() or 1,
        )  # fmt: skip
        app.build(force_all=again)
    return [line.replace(f"{source}/", "") for line in said.getvalue().splitlines() if line.strip()]


def _font() -> Path:
    """Return the font of formulas: without one that knows how, a browser sets hats into their letters."""
    package = importlib.util.find_spec("ziamath")  # needed for nothing else
    assert package is not None
    assert package.origin is not None
    return Path(package.origin).with_name("fonts") / "STIXTwoMath-Regular.ttf"

"""Pages that are built: links lead to the same files, formulas become MathML, and the reference is whole."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from math_core import LatexError

from aerial_il.presentation.documentation import modules
from aerial_il.presentation.documentation.links import moved, with_films
from aerial_il.presentation.documentation.mathml import to_mathml
from tests.presentation.documentation.public_names import public_names

PLACES = {
    "docs/a.md": "a.md",
    "docs/tasks/README.md": "tasks/index.md",
    "docs/tasks/b.jpg": "tasks/b.jpg",
    "docs/tasks/b.mp4": "tasks/b.mp4",
    "experiments/x/README.md": "experiments/x/index.md",
}


@pytest.mark.parametrize(
    ("source", "before", "after"),
    [
        ("docs/a.md", "[t](tasks/README.md#top)", "[t](tasks/index.md#top)"),
        ("docs/a.md", "![p](tasks/b.jpg)", "![p](tasks/b.jpg)"),
        ("experiments/x/README.md", "[a](../../docs/a.md)", "[a](../../a.md)"),
        ("docs/a.md", "[![p](tasks/b.jpg)](tasks/b.mp4)", "[![p](tasks/b.jpg)](tasks/b.mp4)"),
        ("docs/a.md", "[code](../aerial_il/x.py)", "code (`aerial_il/x.py`)"),
        ("docs/a.md", "[q](https://example.org/a.md) [here](#x)", "[q](https://example.org/a.md) [here](#x)"),
    ],
)
def test_links_are_led_to_where_files_have_gone(source: str, before: str, after: str) -> None:
    assert moved(before, source, PLACES) == after


def test_a_picture_of_a_film_becomes_the_film() -> None:
    assert 'poster="b.jpg" src="b.mp4" aria-label="Reach"' in with_films("[![Reach](b.jpg)](b.mp4)")
    below = "[![Reach](b.jpg)](b.mp4)\n\n*Click for the video: an expert flies.*"
    assert with_films(below).endswith("</video>\n\n*An expert flies.*")
    assert with_films("![Reach](b.jpg)") == "![Reach](b.jpg)"


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


def test_what_scripts_rely_on_is_shown() -> None:
    front = {"load", "load_batch", "expert", "load_policy", "open_dataset", "collect", "train", "evaluate"}
    assert {f"aerial_il.{name}" for name in front} <= public_names()


def test_what_is_imported_is_not_shown() -> None:
    names = public_names()
    assert "aerial_il.suite.batch.BatchEnvironment" in names
    assert not {"aerial_il.suite.batch.np", "aerial_il.suite.batch.Scenario"} & names


@pytest.mark.parametrize("module", modules.SHOWN)
def test_a_module_has_a_page_and_says_something(module: str) -> None:
    assert f".. automodule:: {module}\n" in modules.pages()[f"python/{module}.rst"]
    assert f"[`{module}`]({module}.rst)" in modules.pages()["python/index.md"]
    assert any(name.startswith(f"{module}.") for name in public_names())

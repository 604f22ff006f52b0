"""Links lead to the same files after the pages have moved; pictures that lead to a film become the film."""

from __future__ import annotations

import pytest

from aerial_il.presentation.documentation.links import moved, with_films

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

"""Every task has a page that says what it is, and the pages in docs/ are those of the code."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.presentation.pages import task_pages
from aerial_il.suite import tasks

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.mark.parametrize("name", tasks.names())
def test_a_page_names_success_observations_expert_and_robots(name: str) -> None:
    task = tasks.get(name)
    text = task_pages.page(task)
    assert text.startswith(f"# {name}\n\n> {task.instruction}")
    assert all(f"`{field.name}`" in text for field in task.fields())
    assert all(f"`{robot}`" in text for robot, other in tasks.cells() if other == name)
    assert "Phases: `" in text


def test_the_published_pages_are_up_to_date(tmp_path: Path) -> None:
    for path in task_pages.write_pages(tmp_path):
        published = DOCS / path.relative_to(tmp_path)
        assert published.exists(), f"{published} is missing: run `aerial-il docs`"
        assert published.read_text() == path.read_text(), f"{published} is out of date: run `aerial-il docs`"

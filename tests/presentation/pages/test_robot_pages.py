"""Every robot has a page that says what it is, and the pages in docs/ are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from aerial_il import robots
from aerial_il.presentation.pages import robot_pages

DOCS = Path(__file__).resolve().parents[3] / "docs" / "robots"


@pytest.mark.parametrize("name", robots.names())
def test_a_page_names_mass_balance_levels_and_tasks(name: str) -> None:
    robot, text = robots.get(name), robot_pages.page(robots.get(name))
    assert text.startswith(f"# {name}\n")
    for part in (f"{robot.vehicle.mass:.2f} kg", "## Balance", "`ee_pose`", "## Tasks", "Leishman"):
        assert part in text
    assert ("not `pick_place`" in text) == (not robot.has_gripper)


@pytest.mark.parametrize("name", robots.names())
def test_the_drawing_is_small_and_the_same_each_time(name: str) -> None:
    drawing = robot_pages.drawing(robots.get(name))
    assert drawing.startswith("<?xml")
    assert len(drawing) < 150_000
    assert drawing == robot_pages.drawing(robots.get(name))


def test_the_published_pages_are_up_to_date(tmp_path: Path) -> None:
    for path in robot_pages.write_pages(tmp_path):
        published = DOCS / path.name
        assert published.exists(), f"{published} is missing: run `aerial-il docs`"
        if path.stem in robots.names() and path.suffix == ".md":
            assert _figures(published) == _figures(path), f"{published} is out of date: run `aerial-il docs`"


def _figures(path: Path) -> list[str]:
    """The words of a page up to its tasks, without last digits, which may differ between machines."""
    text, _, _ = path.read_text(encoding="utf-8").partition("## Action levels")
    return re.sub(r"(\d+\.\d)\d*", r"\1", text).split()

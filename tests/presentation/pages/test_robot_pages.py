"""Every robot and every task has a page that says what it is, and the pages in docs/ are those of the code."""

import re
from pathlib import Path

import pytest

from aerial_il import robots
from aerial_il.presentation.pages import robot_pages, task_pages
from aerial_il.suite import tasks

ROBOT_DOCS = Path(__file__).resolve().parents[3] / "docs" / "robots"


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


def test_the_published_pages_of_robots_are_up_to_date(tmp_path: Path) -> None:
    for path in robot_pages.write_pages(tmp_path):
        published = ROBOT_DOCS / path.name
        assert published.exists(), f"{published} is missing: run `aerial-il docs`"
        if path.stem in robots.names() and path.suffix == ".md":
            assert _figures(published) == _figures(path), f"{published} is out of date: run `aerial-il docs`"


def _figures(path: Path) -> list[str]:
    """The words of a page up to its tasks, without last digits, which may differ between machines."""
    text, _, _ = path.read_text(encoding="utf-8").partition("## Action levels")
    return re.sub(r"(\d+\.\d)\d*", r"\1", text).split()


TASK_DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.mark.parametrize("name", tasks.names())
def test_a_page_names_success_observations_expert_and_robots(name: str) -> None:
    task = tasks.get(name)
    text = task_pages.page(task)
    assert text.startswith(f"# {name}\n\n> {task.instruction}")
    assert all(f"`{field.name}`" in text for field in task.fields())
    assert all(f"`{robot}`" in text for robot, other in tasks.cells() if other == name)
    assert "Phases: `" in text


def test_the_published_pages_of_tasks_are_up_to_date(tmp_path: Path) -> None:
    for path in task_pages.write_pages(tmp_path):
        published = TASK_DOCS / path.relative_to(tmp_path)
        assert published.exists(), f"{published} is missing: run `aerial-il docs`"
        assert published.read_text() == path.read_text(), f"{published} is out of date: run `aerial-il docs`"

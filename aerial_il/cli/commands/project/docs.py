"""Write the pages that the project makes of itself: one per robot, with its figures and workspace, one per task.

Example: aerial-il docs out=docs
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.configuration.keys import key


@dataclass
class Config:
    out: str = key("docs", "folder that gets robots/NAME.md with a drawing, and tasks/NAME.md")


def run(config: Config) -> None:
    """Write the pages and say where."""
    from aerial_il.evaluation.pages import robot_pages, task_pages

    for path in (*robot_pages.write_pages(config.out), *task_pages.write_pages(config.out)):
        print(path)

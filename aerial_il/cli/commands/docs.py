"""Write the pages that the project makes of itself: one per robot, with its figures, workspace and tasks.

Example: aerial-il docs out=docs
"""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.cli.keys import key


@dataclass
class Config:
    out: str = key("docs", "folder that gets robots/NAME.md and a drawing for every robot")


def run(config: Config) -> None:
    """Write the pages and say where."""
    from aerial_il.evaluation.robot_pages import write_pages

    for path in write_pages(config.out):
        print(path)

"""The frames in which actions and observations are expressed, drawn on a robot from its own numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from aerial_il.presentation.pages.robot_pages import draw_arms, draw_body
from aerial_il.presentation.svg import TEXT_STYLE, svg_text
from aerial_il.robots import figures
from aerial_il.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORWARD, UP, GREY = "#c0392b", "#2b5fae", "#7a8590"
LENGTH = 0.14  # m, of an axis


def drawing(robot: Robot) -> str:
    """Return the side view of a robot with the frames of the world, its base and its tool, as SVG."""
    with rc_context(TEXT_STYLE):
        figure = Figure((7.0, 3.8), layout="constrained")
        axes = figure.subplots()
        draw_body(axes, robot, 2)
        draw_arms(axes, robot, 2)
        chain = figures.chain(robot, np.array(robot.rest_forward, float))[:, [0, 2]]
        ahead = (chain[-1] - chain[-2]) / np.linalg.norm(chain[-1] - chain[-2])
        ground = figures.chain(robot, np.array(robot.rest_down, float))[:, 2].min() - 0.15
        axes.axhline(ground, color=GREY, linewidth=1.0)
        _frame(axes, np.array([-0.55, ground]), np.array([1.0, 0.0]), "world")
        _frame(axes, np.zeros(2), np.array([1.0, 0.0]), "base")
        _frame(axes, chain[-1], ahead, "tool")
        axes.set_aspect("equal")
        axes.margins(0.12)
        axes.axis("off")
        return svg_text(figure)


def _frame(axes: Axes, origin: np.ndarray, ahead: np.ndarray, name: str) -> None:
    """Draw the x and z axes of a frame at ``origin`` (2,) m, with x along the unit vector ``ahead`` (2,)."""
    (x, z), below = origin, 0.5 * LENGTH
    for letter, direction, colour in (("x", ahead, FORWARD), ("z", np.array([-ahead[1], ahead[0]]), UP)):
        (right, up), style = LENGTH * direction, {"arrowstyle": "-|>", "color": colour, "linewidth": 2.0}
        axes.annotate("", (x + right, z + up), (x, z), arrowprops=style)
        axes.plot(x + 1.4 * right, z + 1.4 * up, alpha=0.0)  # limits follow what is plotted
        axes.text(x + 1.18 * right, z + 1.18 * up, letter, color=colour, ha="center", va="center")
    axes.text(x, z - below, name, ha="center", va="top", fontweight="bold")

"""A page per robot: its figures as computed from its own model, its workspace drawn, its tasks."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aerial_il import robots
from aerial_il.control.actions import action_spec, levels_of
from aerial_il.core.files import write_atomic
from aerial_il.presentation.markdown import table
from aerial_il.presentation.svg import TEXT_STYLE, svg_text
from aerial_il.robots import figures
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REACH, BODY, ARM = "#9fc0e6", "#4a4f57", "#d98032"
ARM_CAPTION = "*Side view and top view. Blue: workspace of the tool; orange: rest postures of the arm.*"
ACTUATION = {"under": "underactuated", "full": "fully actuated", "fixed": "fixed base"}
CELLS_PER_REACH = 20  # squares of the drawn workspace along the outstretched arm
NOTE = """\
Computed by `aerial-il docs` from the nominal model that the controller uses. Ideal hover power follows from momentum
theory, `T^(3/2) / sqrt(2 ρ A)` per rotor (Leishman, *Principles of Helicopter Aerodynamics*, 2006, eq. 2.15), with
ρ = 1.225 kg/m³ and the tool down; real rotors of this size have a figure of merit of about 0.65, by which it is
divided. Inertia is about the centre of mass of the whole robot, whose shift is relative to the posture with the tool
down."""


def write_pages(folder: str | os.PathLike[str]) -> list[Path]:
    """Write ``robots/NAME.md`` and ``NAME.svg`` of every robot, and ``robots/README.md``, into ``folder``."""
    place, written = Path(folder) / "robots", []
    place.mkdir(parents=True, exist_ok=True)
    every = [robots.get(name) for name in robots.names()]
    for robot in every:
        for suffix, write in (("md", page), ("svg", drawing)):
            written.append(write_atomic(place / f"{robot.name}.{suffix}", write(robot)))
    return [*written, write_atomic(place / "README.md", overview(every))]


def overview(every: list[Robot]) -> str:
    """Return the table of all robots."""
    columns = ("robot", "actuation", "mass (kg)", "thrust / weight", "joints", "reach (m)", "tasks")
    rows = [
        (f"[{r.name}]({r.name}.md)", ACTUATION[r.actuation], f"{r.vehicle.mass:.2f}",
         _or_none(r.vehicle.thrust_to_weight), r.num_joints, _or_none(r.arm.reach), len(_tasks(r)))
        for r in every
    ]  # fmt: skip
    return f"# Robots\n\n{table(columns, rows)}\n\n{NOTE}\n"


def page(robot: Robot) -> str:
    """Return a robot's page."""
    parts = [
        f"# {robot.name}",
        robot.summary,
        f"[![{robot.name}]({robot.name}.jpg)]({robot.name}.mp4)\n\n*Click for the video: a scripted expert flies it.*",
        f"![Side view and top view]({robot.name}.svg)",
        ARM_CAPTION if robot.num_joints else "*Side view and top view.*",
        _properties(robot),
        "## Balance",
        _balance(robot),
        "## Action levels",
        _levels(robot),
        "## Tasks",
        ", ".join(f"`{task}`" for task in _tasks(robot)) or "None yet.",
        _refused(robot),
        NOTE,
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def drawing(robot: Robot) -> str:
    """Return the side view and the top view of a robot and of where its tool can be, as SVG."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    _, tools = figures.workspace(robot) if robot.num_joints else (None, np.zeros((1, 3)))
    with rc_context(TEXT_STYLE):
        figure = Figure((8.0, 4.0), layout="constrained")
        for axes, (across, up), label in zip(figure.subplots(1, 2), ((0, 2), (0, 1)), ("z (m)", "y (m)"), strict=True):
            if robot.num_joints:
                _draw_reach(axes, tools[:, [across, up]], robot.arm.reach / CELLS_PER_REACH)
            draw_body(axes, robot, up)
            if robot.num_joints:
                draw_arms(axes, robot, up)
            axes.set_xlabel("x (m)")
            axes.set_ylabel(label)
            axes.set_aspect("equal")
            axes.spines[["top", "right"]].set_visible(False)
        return svg_text(figure)


def _properties(robot: Robot) -> str:
    vehicle, rest = robot.vehicle, figures.stances(robot)[0]
    power = figures.hover_power(robot)
    rows = {
        "actuation": ACTUATION[robot.actuation],
        "mass": f"{vehicle.mass:.2f} kg, including the arm's {vehicle.link_mass.sum():.2f} kg"
        if robot.num_joints
        else f"{vehicle.mass:.2f} kg",
        f"inertia, {rest.name}": " ".join(f"{value:.3g}" for value in rest.inertia) + " kg m²",
        "rotors": f"{robot.num_rotors}, up to {robot.base.rotor_max.max():.3g} N each" if robot.num_rotors else "none",
        "thrust / weight": _or_none(vehicle.thrust_to_weight),
        "hover power": f"{power:.0f} W ideal, about {power / figures.FIGURE_OF_MERIT:.0f} W real" if power else "–",
        "lateral force at level hover": f"{robot.lateral_force:.1f} N" if not robot.fixed else "–",
        "arm": f"{robot.num_joints} joint{'s' * (robot.num_joints > 1)}, reach {robot.arm.reach:.2f} m"
        if robot.num_joints
        else "none",
        "gripper": f"opens {200 * robot.gripper.stroke:.1f} cm, {robot.gripper.force:.0f} N per finger"
        if robot.has_gripper
        else "none",
    }
    if robot.num_joints:
        loads = ", ".join(f"{100 * load:.0f}" for load in figures.servo_loads(robot))
        rows["largest static servo load"] = f"{loads} % of the torque limit of each joint"
    return table(("", ""), rows.items())


def _balance(robot: Robot) -> str:
    """Centre of mass and thrusts for each posture."""
    stances = figures.stances(robot)
    columns = ("posture", "tool x, z (m)", "centre of mass x, z (cm)", "shift (cm)", "rotor thrusts (N)")
    rows = []
    for stance in stances:
        shift = 100.0 * float(np.linalg.norm(stance.com - stances[0].com))
        thrusts = " ".join(f"{value:.1f}" for value in stance.thrust) or "–"
        tool, com = (f"{stance.tool[k]:.2f}" for k in (0, 2)), (f"{100 * stance.com[k]:.1f}" for k in (0, 2))
        rows.append((stance.name, ", ".join(tool), ", ".join(com), f"{shift:.1f}", thrusts))
    return table(columns, rows)


def _levels(robot: Robot) -> str:
    rows = [(f"`{level.label}`", action_spec(level, robot.vehicle).size) for level in levels_of(robot.vehicle)]
    return table(("level", "elements"), rows)


def _tasks(robot: Robot) -> list[str]:
    return [task for name, task in tasks.cells() if name == robot.name]


def _refused(robot: Robot) -> str:
    """List the tasks that it cannot do, and why."""
    reasons = {name: tasks.get(name).infeasibility(robot) for name in tasks.names()}
    return "\n".join(f"- not `{name}`: {reason}" for name, reason in reasons.items() if reason)


def _or_none(value: float) -> str:
    return f"{value:.2f}" if value else "–"


def _draw_reach(axes: Axes, points: np.ndarray, cell: float) -> None:
    """Shade the cells (m) of a grid in which at least one of ``points`` (N, 2) lies."""
    from matplotlib.colors import ListedColormap

    low, high = points.min(axis=0) - cell, points.max(axis=0) + cell
    edges = [np.arange(low[k], high[k] + cell, cell) for k in range(2)]
    count, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=(edges[0], edges[1]))
    shade = np.ma.masked_equal((count.T > 0).astype(float), 0.0)
    extent = (edges[0][0], edges[0][-1], edges[1][0], edges[1][-1])
    axes.imshow(shade, origin="lower", extent=extent, cmap=ListedColormap([REACH]), interpolation="nearest")


def draw_body(axes: Axes, robot: Robot, up: int) -> None:
    """Draw hub and rotors, seen along the axis that is neither x nor ``up``."""
    base = robot.base
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    ring = base.rotor_radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    for pos in base.rotor_pos:
        axes.plot([0.0, pos[0]], [0.0, pos[up]], color=BODY, linewidth=1.5)
        axes.plot(pos[0] + ring[:, 0], pos[up] + ring[:, up], color=BODY, linewidth=0.8)
    half, depth = base.hub_size[0], base.pose[2] if robot.fixed and up == 2 else base.hub_size[up]
    axes.fill([-half, half, half, -half], [-depth, -depth, base.hub_size[up], base.hub_size[up]], color=BODY)


def draw_arms(axes: Axes, robot: Robot, up: int) -> None:
    """Draw the arm in its two rest postures."""
    for posture, alpha in ((robot.rest_down, 1.0), (robot.rest_forward, 0.45)):
        chain = figures.chain(robot, np.array(posture, float))
        axes.plot(chain[:, 0], chain[:, up], color=ARM, linewidth=2.2, alpha=alpha, marker="o", markersize=3)

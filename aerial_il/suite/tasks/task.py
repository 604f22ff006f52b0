"""What a task is: props, an episode's random start, observations, rewards and a definition of success.

A task is written once over arrays with a leading world axis. It keeps no state of its own between steps: everything an
episode needs lives in the simulator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Literal

import mujoco
import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot

if TYPE_CHECKING:
    from aerial_il.suite.view import View

Grade = Literal["easy", "medium", "hard"]
FREE_HANG_M = 0.6


class Task(ABC):
    """One task for any robot that can do it.

    Attributes:
        name: registry name. grade: difficulty.
        instruction: the task in one English sentence.
        time_limit_s: seconds until an episode is truncated.
        dwell_s: seconds for which :meth:`solved` must hold for success.
        subtasks: names of the flags that :meth:`progress` returns.
        needs_arm: a bare base cannot do it. needs_flight: a fixed base cannot do it.
        asks_for_force: success takes a force within a band, see :meth:`force_in_band_raw`.
        force_sensors: names of up to two force sensors whose readings the episode remembers, see ``View.force``; of the
            first, the one that a task judges, every physics step of the last control step is kept.
    """

    name: ClassVar[str]
    grade: ClassVar[Grade]
    instruction: ClassVar[str]
    time_limit_s: ClassVar[float]
    dwell_s: ClassVar[float]
    subtasks: ClassVar[tuple[str, ...]]
    needs_arm: ClassVar[bool] = True
    needs_flight: ClassVar[bool] = True
    force_sensors: ClassVar[tuple[str, ...]] = ()
    asks_for_force: ClassVar[bool] = False

    def obstacle(self, robot: Robot) -> str | None:
        """Say why ``robot`` cannot do this task, or None if it can."""
        if self.needs_arm and not robot.num_joints:
            return "it has no arm"
        if self.needs_flight and robot.fixed:
            return "its base is fixed, and the task is not on its table"
        return self.obstacle_to(robot)

    @abstractmethod
    def obstacle_to(self, robot: Robot) -> str | None:
        """Say what of :meth:`obstacle` is peculiar to this task."""

    @abstractmethod
    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        """Add objects, goals and sensors to the scene."""

    @abstractmethod
    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        """Place robot and props of one cleared world at the random start of an episode."""

    @abstractmethod
    def fields(self) -> tuple[Field, ...]:
        """Fields of :meth:`observe`."""

    @abstractmethod
    def observe(self, view: View) -> dict[str, np.ndarray]:
        """What is to be known of objects and goals, each (n, ...)."""

    def remember(self, view: View, mask: np.ndarray) -> None:  # noqa: B027, most tasks have nothing to remember
        """Note in ``view.memory`` what success depends on beyond the present instant; called once per control step.

        Args:
            view: the worlds. mask: (n,) bool, the worlds that have just moved; leave the others alone.
        """

    @abstractmethod
    def solved(self, view: View) -> np.ndarray:
        """(n,) bool: the success condition holds at this instant."""

    def lost(self, view: View) -> np.ndarray:
        """(n,) bool: the object is out of reach for good, so that the episode ends as a failure, ``dropped``."""
        return np.zeros(view.n, bool)

    def force_in_band_raw(self, view: View) -> np.ndarray:
        """(n,) share of the time in contact in which the unfiltered force was as asked; NaN where none is asked for."""
        return np.full(view.n, np.nan)

    @abstractmethod
    def progress(self, view: View) -> np.ndarray:
        """(n, K) bool flags named by :attr:`subtasks`, at this instant."""

    @abstractmethod
    def reward(self, view: View) -> np.ndarray:
        """(n,) dense reward in [0, 1] at this instant."""


def hover_start(view: View, world: int, base_pos: np.ndarray, yaw: float) -> None:
    """Put the robot of one world at rest: base at ``base_pos`` (3,) m, heading ``yaw`` rad, arm down, gripper open.

    Starts are chosen for tools that hang up to ``FREE_HANG_M`` below the base; a robot whose tool hangs lower starts
    higher by the difference. A fixed robot starts with its tool as near as it can to where it would hang.
    """
    robot, vehicle = view.robot, view.robot.vehicle
    posture = _standing_posture(robot, base_pos, yaw) if robot.fixed else np.array(robot.rest_down, float)
    if not robot.fixed:
        raised = base_pos[2] + max(0.0, robot.hang - FREE_HANG_M)
        view.qpos[world, :7] = [*base_pos[:2], raised, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
    view.joint_pos[world] = posture
    fingers = robot.first_joint[0] + robot.num_joints
    hover = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
    commands = [*hover, *posture]
    if robot.has_gripper:
        view.qpos[world, fingers : fingers + 2] = robot.gripper.stroke
        commands.append(robot.gripper.stroke)
    view.worlds.bind("act")[world, : robot.num_rotors] = hover
    view.worlds.bind("ctrl")[world, : len(commands)] = commands


def _standing_posture(robot: Robot, base_pos: np.ndarray, yaw: float) -> np.ndarray:
    """(J,) joints of a fixed robot, tool down: on the way from its rest to below ``base_pos``, as far as it reaches."""
    home = np.array(robot.base.pose[:3]) + robot.tool_at(robot.rest_down)[0]
    wanted = base_pos - np.array([0.0, 0.0, FREE_HANG_M])
    for share in np.linspace(1.0, 0.0, 11):
        posture = robot.posture_for(home + share * (wanted - home), pointing_down(yaw))
        if posture is not None:
            return posture
    return np.array(robot.rest_down, float)


def pointing_down(yaw: float) -> np.ndarray:
    """Rotation (3, 3), world from tool, of a tool that points straight down with heading ``yaw`` rad."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])

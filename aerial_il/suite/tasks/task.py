"""Base class of tasks: props, random starts, observations, rewards and a definition of success.

A task is written once, for one world: scene and random start in Python, what is asked in every step as compiled
functions that the threads call which fly the worlds. It keeps no state of its own between steps: everything an episode
needs lives in the simulator.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import mujoco
import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.episode_state import MAX_OBJECTS, PAST_SIZE
from aerial_il.suite.physics.world import Names

if TYPE_CHECKING:
    from aerial_il.suite.physics.view import View

Grade = Literal["easy", "medium", "hard"]
FREE_HANG_M = 0.6


@dataclass(frozen=True)
class TaskKernels:
    """Compiled functions of a task that are called in every step, each of one world at this instant.

    ``world`` is read by the functions of :mod:`aerial_il.suite.physics.world`, in which the k-th site, joint … is the
    k-th of the task's names.

    Attributes:
        observe: ``(world, found)`` writes what is to be known of objects and goals, in the order of the task's fields.
        solved: ``world -> bool``, the success condition holds.
        progress: ``(world, flags)`` writes ones and zeros for :attr:`Task.subtasks`.
        reward: ``world -> float``, dense, in [0, 1].
        remember: ``(world)`` notes in ``task_state(world)`` what success depends on beyond this instant; called once
            per control step, before the others.
        lost: ``world -> bool``, the object is out of reach for good: the episode ends as a failure, ``dropped``.
        force_in_band_raw: ``world -> float``, share of the time in contact in which the unfiltered force was as asked;
            NaN without contact.
    """

    observe: Callable[..., Any]
    solved: Callable[..., Any]
    progress: Callable[..., Any]
    reward: Callable[..., Any]
    remember: Callable[..., Any] | None = None
    lost: Callable[..., Any] | None = None
    force_in_band_raw: Callable[..., Any] | None = None


class Task(ABC):
    """One task for any robot that can do it.

    Args:
        kernels: its compiled functions.

    Attributes:
        name: registry name. grade: difficulty.
        instruction: the task in one English sentence. wordings: others of it, English and Chinese, that a policy which
            is told in words knows. held_out: wordings that none knows, to ask with.
        time_limit_s: seconds until an episode is truncated.
        dwell_s: seconds for which it must be solved for success.
        subtasks: names of its flags. once_lost: those of them whose loss no later deed makes good.
        names: what its compiled functions read, in the order in which they number it.
        needs_arm: a bare base cannot do it. needs_flight: a fixed base cannot do it.
        asks_for_force: success takes a force within a band.
        force_sensors: names of up to two force sensors whose readings the episode remembers; of the first, the one that
            a task judges, every physics step of the last control step is kept.
        commanded: sites and mocap bodies of ``names`` that the user gives the robot as numbers: it need not see them,
            and they are exact in every tier.
        velocities: sites whose velocity (m/s, world) the task's state keeps to show, each with the first of its three
            places there: ``estimation`` shows it as late and wrong as it sees the object.
        privileged: fields that no real robot has, each with the reason.
        goal: which fields hold what is wanted and what has been achieved, and what any of it is paid, where success is
            a matter of the goal alone; None elsewhere.
        sight: objects that are seen, and numbers of what moves of them (7 a site, 2 a joint, 3 a velocity), of a task
            that has more of either than the fixed layout of an episode's memory holds.
        scene_height_m: of the point that the camera ``scene`` looks at. scene_distance: how far off that camera is, in
            units of what suits a table.
    """

    name: ClassVar[str]
    grade: ClassVar[Grade]
    instruction: ClassVar[str]
    wordings: ClassVar[tuple[str, ...]] = ()
    held_out: ClassVar[tuple[str, ...]] = ()
    time_limit_s: ClassVar[float]
    dwell_s: ClassVar[float]
    subtasks: ClassVar[tuple[str, ...]]
    once_lost: ClassVar[tuple[str, ...]] = ()
    needs_arm: ClassVar[bool] = True
    needs_flight: ClassVar[bool] = True
    force_sensors: ClassVar[tuple[str, ...]] = ()
    asks_for_force: ClassVar[bool] = False
    names: ClassVar[Names] = Names()
    commanded: ClassVar[tuple[str, ...]] = ()
    velocities: ClassVar[Mapping[str, int]] = {}
    privileged: ClassVar[tuple[tuple[str, str], ...]] = ()
    goal: ClassVar[GoalSpec | None] = None
    sight: ClassVar[tuple[int, int]] = (MAX_OBJECTS, PAST_SIZE)
    scene_height_m: ClassVar[float] = 0.9
    scene_distance: ClassVar[float] = 1.0

    def __init__(self, kernels: TaskKernels) -> None:
        self.kernels = kernels

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.grade}, {self.time_limit_s:g} s: {self.instruction})"

    def infeasibility(self, robot: Robot) -> str | None:
        """Say why ``robot`` cannot do this task, by the task's rules or in its own file, or None if it can."""
        if self.needs_arm and not robot.num_joints:
            return "it has no arm"
        if self.needs_flight and robot.fixed:
            return "its base is fixed, and the task is set up for robots that fly"
        return self.own_infeasibility(robot) or robot.declines.get(self.name)

    @abstractmethod
    def own_infeasibility(self, robot: Robot) -> str | None:
        """Say what of :meth:`infeasibility` is peculiar to this task."""

    @abstractmethod
    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        """Add objects, goals and sensors to the scene."""

    @abstractmethod
    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        """Place robot and props of one cleared world at the random start of an episode."""

    @abstractmethod
    def fields(self) -> tuple[Field, ...]:
        """Fields of what ``kernels.observe`` writes."""


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
    commands = [*posture]
    if robot.has_gripper:
        view.qpos[world, fingers : fingers + 2] = robot.gripper.stroke
        commands.append(robot.gripper.stroke)
    view.thrust[world] = view.rotor_command[world] = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
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

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


class Task(ABC):
    """One task for any robot that can do it.

    Attributes:
        name: registry name. grade: difficulty.
        instruction: the task in one English sentence.
        time_limit_s: seconds until an episode is truncated.
        dwell_s: seconds for which :meth:`solved` must hold for success.
        subtasks: names of the flags that :meth:`progress` returns.
    """

    name: ClassVar[str]
    grade: ClassVar[Grade]
    instruction: ClassVar[str]
    time_limit_s: ClassVar[float]
    dwell_s: ClassVar[float]
    subtasks: ClassVar[tuple[str, ...]]

    @abstractmethod
    def obstacle_to(self, robot: Robot) -> str | None:
        """Say why ``robot`` cannot do this task, or None if it can."""

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

    @abstractmethod
    def solved(self, view: View) -> np.ndarray:
        """(n,) bool: the success condition holds at this instant."""

    @abstractmethod
    def progress(self, view: View) -> np.ndarray:
        """(n, K) bool flags named by :attr:`subtasks`, at this instant."""

    @abstractmethod
    def reward(self, view: View) -> np.ndarray:
        """(n,) dense reward in [0, 1] at this instant."""


def hover_start(view: View, world: int, base_pos: np.ndarray, yaw: float) -> None:
    """Put the robot of one world at rest: base at ``base_pos`` (3,) m, heading ``yaw`` rad, arm down, gripper open."""
    robot = view.robot
    qpos = view.qpos[world]
    qpos[:3] = base_pos
    qpos[3:7] = [np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
    qpos[7 : 7 + robot.num_joints] = robot.rest_down
    qpos[7 + robot.num_joints : 9 + robot.num_joints] = robot.gripper.stroke
    rotors = robot.num_rotors
    vehicle = robot.vehicle
    view.worlds.bind("act")[world, :rotors] = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
    view.worlds.bind("ctrl")[world, :rotors] = view.worlds.bind("act")[world, :rotors]
    view.worlds.bind("ctrl")[world, rotors : rotors + robot.num_joints] = robot.rest_down
    view.worlds.bind("ctrl")[world, rotors + robot.num_joints] = robot.gripper.stroke

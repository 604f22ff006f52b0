"""What is flown: one cell, one tier, one action level, some cameras, checked before anything is built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks, tiers
from aerial_il.suite.aerodynamics import Air
from aerial_il.suite.observations import robot_fields
from aerial_il.suite.rendering import CameraRequest, parse_cameras
from aerial_il.suite.scene import CONTROL_DT_S, build_xml
from aerial_il.suite.tasks.task import Task
from aerial_il.suite.worlds import STATE


@dataclass(frozen=True)
class Scenario:
    """What is flown: one cell, one tier, one action level, some cameras.

    Raises:
        UnknownNameError: unknown robot, task, tier, action level or camera.
        CellError: the robot cannot do the task.
    """

    robot_name: str
    task_name: str
    tier_name: str = "calm"
    action: str = "ee_pose"
    cameras: Sequence[str] = ()
    image_size: tuple[int, int] = (240, 320)

    def __post_init__(self) -> None:
        tasks.check_cell(self.robot_name, self.task_name)
        tiers.get(self.tier_name)
        ActionLevel.parse(self.action)
        parse_cameras(self.cameras)
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "image_size", tuple(self.image_size))
        if len(self.image_size) != 2 or not (0 < self.image_size[0] <= 960 and 0 < self.image_size[1] <= 1280):
            raise InvalidValueError(f"image_size is (height, width) up to (960, 1280), got {self.image_size}.")

    @property
    def robot(self) -> Robot:
        return robots.get(self.robot_name)

    @property
    def task(self) -> Task:
        return tasks.get(self.task_name)

    @property
    def level(self) -> ActionLevel:
        return ActionLevel.parse(self.action)

    @property
    def camera_requests(self) -> tuple[CameraRequest, ...]:
        return parse_cameras(self.cameras)

    @property
    def air(self) -> Air:
        """The tier's gusts on this robot, in newtons and newton metres."""
        tier, weight = tiers.get(self.tier_name), self.robot.vehicle.mass * GRAVITY
        force, limit = tier.gust_force * weight, tier.gust_limit * weight
        return Air(force, limit, force * tier.gust_arm_m, limit * tier.gust_arm_m, tier.gust_time_s)

    @cached_property
    def xml(self) -> str:
        """The scene as stand-alone MJCF."""
        return build_xml(self.robot, self.task)

    def compile(self) -> mujoco.MjModel:
        """Compile the scene from its XML, so that a stored XML gives the same model bit for bit."""
        return mujoco.MjModel.from_xml_string(self.xml)

    @cached_property
    def spec(self) -> EnvSpec:
        """Specification of observations and actions."""
        images = tuple(
            Field(c.key, (*self.image_size, *c.channels), "image", dtype=c.dtype) for c in self.camera_requests
        )
        state = (*robot_fields(self.robot), *self.task.fields())
        return EnvSpec(
            robot=self.robot_name,
            task=self.task_name,
            tier=self.tier_name,
            observation=ObservationSpec((*state, *images)),
            action=action_spec(self.level, self.robot.vehicle),
            control_dt_s=CONTROL_DT_S,
            max_steps=round(self.task.time_limit_s / CONTROL_DT_S),
            instruction=self.task.instruction,
            subtasks=self.task.subtasks,
            state_size=mujoco.mj_stateSize(self.compile(), STATE),
        )

"""Scenarios: a cell with a tier, an action level, a flight law and cameras, checked before anything is built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec, check_level
from aerial_il.core import registry
from aerial_il.core.checks import require_integer
from aerial_il.core.errors import UnknownNameError
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.robots.parts.camera import check_size
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks, tiers
from aerial_il.suite.cameras import SCENE, CameraRequest, parse_cameras
from aerial_il.suite.physics.episode_state import sight_size
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.suite.physics.rotors import rotor_wrenches
from aerial_il.suite.scene import build_xml
from aerial_il.suite.sensors import robot_fields
from aerial_il.suite.tasks.task import Task
from aerial_il.suite.tiers import Tier
from aerial_il.suite.timing import CONTROL_DT_S


@dataclass(frozen=True)
class Scenario:
    """A cell with a tier, an action level, a flight law and cameras: everything that defines an environment.

    Attributes:
        cameras: images among the observations, see :func:`parse_cameras`.
        image_size: height and width of images, pixels, where neither ``cameras`` nor the robot says another.
        horizon: episodes of so many steps of 20 ms, which success does not end; None for the task's time limit, and
            an end at success.

    Raises:
        UnknownNameError: unknown robot, task, tier, component of a tier, camera or controller; action level that the
            robot does not have.
        CellError: the robot cannot do the task.
        InvalidValueError: ``image_size`` or ``horizon`` is out of range.
    """

    robot_name: str
    task_name: str
    tier_name: str = "calm"
    action: str = "ee_pose"
    cameras: Sequence[str] = ()
    image_size: tuple[int, int] = (240, 320)
    controller: str = "geometric_observer"
    horizon: int | None = None

    def __post_init__(self) -> None:
        tasks.check_cell(self.robot_name, self.task_name)
        object.__setattr__(self, "tier_name", self.tier.name)
        check_level(self.level, self.robot.vehicle, self.robot_name)
        registry.get("controller", self.controller)
        check_size(self.image_size)
        object.__setattr__(self, "image_size", tuple(self.image_size))
        parse_cameras(self.cameras, self.camera)
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if self.horizon is not None:  # one of the time limit's length could not be told from none
            limit = limit_of(self.task)
            hint = f"{self.task_name} has a time limit of {limit} steps, which success ends."
            require_integer("horizon", self.horizon, 1, limit - 1, hint)

    def __str__(self) -> str:
        return f"{self.robot_name}/{self.task_name}, {self.tier_name}, {self.level.label}"

    @property
    def robot(self) -> Robot:
        return robots.get(self.robot_name)

    @property
    def task(self) -> Task:
        return tasks.get(self.task_name)

    @property
    def level(self) -> ActionLevel:
        return ActionLevel.parse(self.action)

    @cached_property
    def camera_requests(self) -> tuple[CameraRequest, ...]:
        return parse_cameras(self.cameras, self.camera)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of all cameras: the scene's, then the robot's."""
        return (SCENE, *(camera.name for camera in self.robot.mounted_cameras))

    def camera(
        self, name: str, modality: str = "rgb", size: tuple[int, int] | None = None, **timing: int
    ) -> CameraRequest:
        """Return a request of one camera's image, of ``size`` (height, width) pixels, its own or ``image_size``.

        Args:
            timing: ``every`` and ``delay`` of :class:`CameraRequest`.

        Raises:
            UnknownNameError: no such camera or modality.
        """
        if name not in self.camera_names:
            raise UnknownNameError("camera", name, self.camera_names)
        own = {camera.name: camera.size for camera in self.robot.mounted_cameras}
        return CameraRequest(name, modality, size or own.get(name) or self.image_size, **timing)

    @property
    def tier(self) -> Tier:
        return tiers.get(self.tier_name)

    @property
    def disturbances(self) -> dict[str, Any]:
        """The tier's components as plain values: strengths, what they amount to on this robot, numbers remembered."""
        found = self.tier.to_dict()
        for name, part in self.tier.parts.items():
            found[name] |= part.about(self.robot) | ({"memory": part.memory} if part.memory else {})
        return found

    @cached_property
    def xml(self) -> str:
        """The scene as stand-alone MJCF."""
        return build_xml(self.robot, self.task, self.tier.userdata_size + sight_size(*self.task.sight))

    def compile(self) -> mujoco.MjModel:
        """Compile the scene from its XML, so that a stored XML gives the same model bit for bit."""
        return mujoco.MjModel.from_xml_string(self.xml)

    @cached_property
    def rotors(self) -> np.ndarray:
        """(R, 6) force and torque about the base origin of each rotor per newton of thrust, base frame; as built."""
        return rotor_wrenches(self.model)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled scene, to look things up in."""
        return self.compile()

    @cached_property
    def spec(self) -> EnvSpec:
        """Specification of observations and actions."""
        images = (request.field for request in self.camera_requests)
        state = (*robot_fields(self.robot), *self.task.fields())
        return EnvSpec(
            robot=self.robot_name,
            task=self.task_name,
            tier=self.tier_name,
            observation=ObservationSpec((*state, *images)),
            action=action_spec(self.level, self.robot.vehicle),
            control_dt_s=CONTROL_DT_S,
            max_steps=self.horizon or limit_of(self.task),
            instruction=self.task.instruction,
            subtasks=self.task.subtasks,
            state_size=mujoco.mj_stateSize(self.model, STATE),
            disturbances=self.disturbances,
            controller=self.controller,
        )


def limit_of(task: Task) -> int:
    """Return the time limit of ``task`` in steps."""
    return round(task.time_limit_s / CONTROL_DT_S)


def horizon_of(spec: EnvSpec) -> int | None:
    """Return the horizon that a scenario was made with, or None where its task's time limit was its own."""
    return spec.max_steps if spec.max_steps < limit_of(tasks.get(spec.task)) else None

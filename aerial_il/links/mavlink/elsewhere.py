"""A robot behind an autopilot as a link: what it shows of itself, and set points of its base, its arm or its tool.

Over MAVLink a robot tells nothing of objects: of the observation there are the robot's own fields alone. The tool's
pose follows from base and joints; tool poses are flown by whole-body control on this side (:mod:`.companion`).
"""

from dataclasses import replace
from typing import Any

import numpy as np

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, ObservationSpec
from aerial_il.links.companion import Companion
from aerial_il.links.link import Order, Reading, RefusedError, require_linked
from aerial_il.links.mavlink.client import OffboardClient
from aerial_il.links.mavlink.frames import matrix
from aerial_il.links.mavlink.telemetry import VehicleState
from aerial_il.suite.scenario import Scenario

TOLD = ("base_pos", "base_rot6d", "base_vel", "base_angvel", "joint_pos", "joint_vel", "gripper", "ee_pos", "ee_rot6d")
ANY_TASK = "hover"


class AutopilotLink:
    """A robot whose autopilot sends to this machine.

    Args:
        robot: registry name. port: for its datagrams. level: of the actions in its specification.
        patience_s: with an autopilot that says nothing.

    Raises:
        InvalidValueError: the level is not flown over a link. LinkError: the port is in use, or no autopilot sends.
    """

    lockstep = False

    def __init__(self, robot: str, *, port: int, level: str, patience_s: float) -> None:
        self._begin(robot, level, OffboardClient(robot, port=port, patience_s=patience_s))
        task = ANY_TASK if not robots.get(robot).num_joints else "reach"
        whole = Scenario(robot, task, action=level).spec
        own = tuple(field for field in whole.observation.fields if field.name in TOLD)
        self.spec: EnvSpec = replace(whole, observation=ObservationSpec(own), subtasks=(), state_size=0)

    def _begin(self, robot: str, level: str, client: OffboardClient) -> None:
        require_linked(level)
        self._vehicle, self._client = robots.get(robot).vehicle, client
        self._companion = Companion(self._vehicle)
        self._sizes = {
            each: action_spec(ActionLevel.parse(each), self._vehicle).size
            for each in ("ee_pose", "base_joint", "velocity")
        }
        client.connect()

    def read(self) -> Reading | None:
        state = self._client.state if self.lockstep else self._client.poll()
        return None if state is None else self._reading(state)

    def send(self, level: str, action: np.ndarray) -> None:
        action = np.asarray(action, float)
        if level not in self._sizes:
            raise RefusedError(f"{level!r} is not flown over MAVLink. Valid: {', '.join(self._sizes)}.")
        if action.shape != (self._sizes[level],) or not np.isfinite(action).all():
            raise RefusedError(f"{level} takes {self._sizes[level]} finite numbers, got {action}.")
        if level == "ee_pose":
            level, action = "base_joint", self._companion.base_joint(action, self._own(self._client.state))
        self._client.send(level, action)

    def order(self, order: Order, **numbers: float) -> None:
        if order is Order.RESET:
            raise RefusedError(
                "A robot behind an autopilot is not set back to the start of an episode. Fly it from where it is: "
                "python -m aerial_il.links.onboard policy=EXPORTED link=mavlink, or aerial_il.vehicle('mavlink')."
            )
        self._companion.reset()
        self._client.order(order.value, **numbers)

    def step(self) -> None:
        raise InvalidValueError("The time of this robot does not wait.")

    def close(self) -> None:
        self._client.close()

    def _reading(self, state: VehicleState) -> Reading:
        return Reading(self._own(state), state.stamp, state.mode, state.armed, self._told())

    def _told(self) -> dict[str, Any]:
        return {}

    def _own(self, state: VehicleState) -> dict[str, np.ndarray]:
        """Return what the robot shows of itself, name -> (*shape,)."""
        rot = matrix(state.quat)
        tool, turned = self._companion.tool(state.pos, rot, state.joints)
        return {
            "base_pos": state.pos,
            "base_rot6d": rot[:, :2].T.ravel(),
            "base_vel": state.vel,
            "base_angvel": state.angvel,
            "joint_pos": state.joints,
            "joint_vel": state.joint_vel,
            "gripper": np.array([state.opening]),
            "ee_pos": tool,
            "ee_rot6d": turned[:, :2].T.ravel(),
        }

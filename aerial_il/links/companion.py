"""Whole-body control on the companion computer: tool poses become set points of base and joints.

For autopilots, which know of no tool: the same compiled references and inverse kinematics as in the suite's own
controller, fed with what the robot shows. The arm is solved from the base's actual pose, so that it makes up for what
the base is off by.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from aerial_il.control import controller_state as layout
from aerial_il.control.controller import Controller
from aerial_il.control.dynamics import forward_kinematics, tool_pose
from aerial_il.control.scratch import make_scratch
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.rotations import mat_from_rot6d


class Companion:
    """Follows tool poses with one vehicle.

    Args:
        vehicle: nominal model.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._controller = Controller(vehicle, level="ee_pose")
        self._thrust = np.zeros(vehicle.num_rotors)
        self._record, self._frames = vehicle.record, make_scratch().frames

    def reset(self) -> None:
        """Begin where the robot is when it is next asked."""
        self._controller.reset()

    def tool(self, pos: np.ndarray, rot: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position (3,) and rotation (3, 3), world from tool, for a base at ``pos`` (3,), ``rot`` (3, 3)."""
        place, turned = tuple(map(float, pos)), tuple(map(float, rot.ravel()))
        forward_kinematics(self._record, place, turned, np.ascontiguousarray(joints), 0, self._frames)
        tool, tool_rot = tool_pose(self._record, self._frames)
        return np.array(tool), np.array(tool_rot).reshape(3, 3)

    def base_joint(self, action: np.ndarray, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the set point at ``base_joint`` for one at ``ee_pose``; to be called once a control step.

        Args:
            action: (Da,) tool position, rot6d and gripper. obs: what the robot shows, name -> (*shape,).
        """
        controller, state = self._controller, self._controller.state
        arm = slice(layout.JOINT_CMD, layout.JOINT_CMD + controller.vehicle.num_joints)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, mat_from_rot6d(obs["base_rot6d"]).ravel())
        qvel = np.concatenate([obs["base_vel"], obs["base_angvel"], obs["joint_vel"]])
        for _ in range(controller.ticks_per_action):
            at = state[arm] if state[layout.READY] else obs["joint_pos"]  # joints that lag over a link are no contact
            controller.update(action, np.concatenate([obs["base_pos"], quaternion, at]), qvel, self._thrust)
        base = state[layout.BASE_POS : layout.BASE_POS + 3]
        return np.array([*base, state[layout.BASE_YAW], *state[arm], *action[9:]])

"""Named ``(n, ...)`` measurements of the worlds: what experts, studies and tests read.

Everything is a live view or derived from one; nothing here writes to the simulator.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.errors import UnknownNameError
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.physics_batch import PhysicsBatch
from aerial_il.suite.physics.world import ARRAYS, WORLD, Names

OBJECTS = {
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
}


class View:
    """Read the robot and the props of n worlds.

    Args:
        worlds: the simulator. robot: what flies in it. names: what the task reads in compiled code.

    Attributes:
        records: (n,) :data:`aerial_il.suite.physics.world.WORLD`, what compiled code of the task is called with.
    """

    def __init__(self, worlds: PhysicsBatch, robot: Robot, names: Names) -> None:
        self.worlds, self.robot, self.model = worlds, robot, worlds.model
        self.n = worlds.n
        self.qpos, self.qvel = worlds.bind("qpos"), worlds.bind("qvel")
        self.userdata = worlds.bind("userdata")
        self._site_pos, self._site_mat = worlds.bind("site_xpos"), worlds.bind("site_xmat")
        self._sensors, self.mocap_pos = worlds.bind("sensordata"), worlds.bind("mocap_pos")
        self.mocap_quat = worlds.bind("mocap_quat")
        self._tool, self.base_site = self._site("tool"), self._site("imu")
        self._ids: dict[tuple[str, str], int] = {}
        self._joints: dict[str, tuple[int, int]] = {}
        (first_pos, first_vel), count = robot.first_joint, robot.num_joints
        self.joint_pos = self.qpos[:, first_pos : first_pos + count]
        self.joint_vel = self.qvel[:, first_vel : first_vel + count]
        twist = np.zeros((self.n, 6)) if robot.fixed else self.qvel[:, :6]
        self.base_pos, self.base_vel, self.base_angvel = self._site_pos[:, self.base_site], twist[:, :3], twist[:, 3:]
        self._finger = first_pos + count
        contacts = ["contact_base", *(f"contact_link_{i}" for i in range(robot.num_joints))]
        self._contact_ids = np.array([self.address(name) for name in contacts])
        self.records = self._records(names)

    @property
    def tool_pos(self) -> np.ndarray:
        """(n, 3) tool position, world, m."""
        return self._site_pos[:, self._tool]

    @property
    def tool_mat(self) -> np.ndarray:
        """(n, 9) rotation, world from tool, row by row."""
        return self._site_mat[:, self._tool].reshape(self.n, 9)

    @property
    def tip_pos(self) -> np.ndarray:
        """(n, 3) point between the fingers' ends, world, m: what touches first when the closed gripper pushes."""
        return self.tool_pos + self.robot.gripper.tip_distance * self.tool_mat[:, 0::3]

    @property
    def base_mat(self) -> np.ndarray:
        """(n, 9) rotation, world from base, row by row."""
        return self._site_mat[:, self.base_site].reshape(self.n, 9)

    @property
    def base_rot6d(self) -> np.ndarray:
        """(n, 6)."""
        return rot6d_from_mat(self.base_mat)

    @property
    def tool_rot6d(self) -> np.ndarray:
        """(n, 6)."""
        return rot6d_from_mat(self.tool_mat)

    @property
    def air_force(self) -> np.ndarray:
        """(n, 3) wind, drag and ground effect on the base in the last physics step, world, N."""
        return self.userdata[:, layout.AIR]

    @property
    def thrust(self) -> np.ndarray:
        """(n, R) thrusts of the rotors, N; what is written counts."""
        return self.userdata[:, layout.THRUST][:, : self.robot.num_rotors]

    @property
    def rotor_command(self) -> np.ndarray:
        """(n, R) commands to the rotors in the last physics step, N; what is written counts."""
        return self.userdata[:, layout.COMMAND][:, : self.robot.num_rotors]

    @property
    def gripper(self) -> np.ndarray:
        """(n, 1) opening of the gripper: 0 closed, 1 open."""
        left, right = (self.qpos[:, k : k + 1] for k in (self._finger, self._finger + 1))
        return 0.5 * (left + right) / self.robot.gripper.stroke

    def site_pos(self, name: str) -> np.ndarray:
        """(n, 3) position of a site, world, m."""
        return self._site_pos[:, self._cached(self._site, name)]

    def site_mat(self, name: str) -> np.ndarray:
        """(n, 9) rotation of a site, world, row by row."""
        return self._site_mat[:, self._cached(self._site, name)].reshape(self.n, 9)

    def force(self, k: int = 0) -> np.ndarray:
        """(n, 3) net contact force that the task's force sensor number ``k`` measures, world, N."""
        start = layout.FORCES.start + 3 * k
        return self.userdata[:, start : start + 3]

    def peak_force(self, k: int = 0) -> np.ndarray:
        """(n,) largest magnitude of that force since the start of the episode, N."""
        return self.userdata[:, layout.FORCES.start + 3 * layout.MAX_FORCES + k]

    @property
    def task_state(self) -> np.ndarray:
        """(n, 8) numbers that the task may write in ``TaskKernels.remember``; zero at the start of an episode."""
        return self.userdata[:, layout.TASK]

    def joint(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """(n,) position (rad or m) and (n,) velocity of a hinge or slide joint; live views."""
        position, velocity = self._joint(name)
        return self.qpos[:, position], self.qvel[:, velocity]

    def touching(self, sensor: str) -> np.ndarray:
        """(n,) bool: a contact sensor sees at least one contact."""
        return self._sensors[:, self._cached(self.address, sensor)] > 0.0

    def free_joint(self, name: str) -> tuple[slice, slice]:
        """Slices of a free joint in qpos (7) and qvel (6)."""
        position, velocity = self._joint(name)
        return slice(position, position + 7), slice(velocity, velocity + 6)

    def mocap_id(self, body: str) -> int:
        """Index of a mocap body."""
        return self._cached(self._mocap, body)

    def _cached(self, find: Callable[[str], int], name: str) -> int:
        """Answer of ``find`` to a name, kept: looking names up in the model takes longer than their use."""
        key = (find.__name__, name)
        if key not in self._ids:
            self._ids[key] = find(name)
        return self._ids[key]

    def _joint(self, name: str) -> tuple[int, int]:
        """Indices of a joint's first position and first velocity."""
        if name not in self._joints:
            joint = self._id("joint", name)
            self._joints[name] = int(self.model.jnt_qposadr[joint]), int(self.model.jnt_dofadr[joint])
        return self._joints[name]

    def _mocap(self, body: str) -> int:
        mocap = int(self.model.body_mocapid[self._id("body", body)])
        if mocap < 0:
            bodies = range(self.model.nbody)
            movable = [self.model.body(i).name for i in bodies if self.model.body_mocapid[i] >= 0]
            raise UnknownNameError("mocap body", body, movable)
        return mocap

    def _site(self, name: str) -> int:
        return self._id("site", name)

    def _id(self, kind: str, name: str) -> int:
        """Index of something of the model; MuJoCo itself says -1 to an unknown name, which is the last one's index."""
        found = mujoco.mj_name2id(self.model, OBJECTS[kind], name)
        if found < 0:
            model = self.model
            count = {"site": model.nsite, "joint": model.njnt, "sensor": model.nsensor, "actuator": model.nu}
            known = (mujoco.mj_id2name(self.model, OBJECTS[kind], i) for i in range(count.get(kind, self.model.nbody)))
            raise UnknownNameError(kind, name, [name for name in known if name])
        return found

    def _records(self, names: Names) -> np.ndarray:
        """Records by which compiled code finds the worlds; see :mod:`aerial_il.suite.physics.world`."""
        records, robot = np.zeros(self.n, WORLD), self.robot
        for name in ARRAYS:
            array = self.worlds.bind(name)
            records[name] = [row.ctypes.data for row in array.reshape(self.n, -1)] if array.size else 0
        joints = [self._joint(name) for name in names.joints]
        for name, found in (
            ("sites", [self._site(name) for name in names.sites]),
            ("joints", [position for position, _ in joints]),
            ("dofs", [velocity for _, velocity in joints]),
            ("contacts", [self.address(name) for name in names.contacts]),
            ("mocaps", [self._mocap(name) for name in names.mocaps]),
            ("actuators", [self._id("actuator", name) for name in names.actuators]),
            ("unwanted", self._contact_ids),
        ):
            records[name][:, : len(found)] = found
        records["tool"], records["base"], records["fingers"] = self._tool, self.base_site, self._finger
        records["first_joint"], records["first_dof"] = robot.first_joint
        records["num_joints"], records["num_rotors"] = robot.num_joints, robot.num_rotors
        records["num_unwanted"], records["flies"] = len(self._contact_ids), not robot.fixed
        records["grips"], records["stroke"] = robot.has_gripper, robot.gripper.stroke
        records["tip_distance"], records["lateral_limit"] = robot.gripper.tip_distance, robot.vehicle.lateral_limit
        records["longest_reach"] = robot.longest_reach
        records["weight"] = robot.vehicle.mass * GRAVITY
        return records

    def address(self, sensor: str) -> int:
        """Index of a sensor's first number in ``sensordata``."""
        return int(self.model.sensor_adr[self._id("sensor", sensor)])

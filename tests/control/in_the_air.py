"""A robot alone in the air, flown by the public controller in a plain MuJoCo model: no suite, no task."""

from collections.abc import Callable

import mujoco
import numpy as np

from aerial_il import robots
from aerial_il.control.controller import Controller
from aerial_il.control.vehicle import GRAVITY, Gains
from aerial_il.core.rotations import rot6d_from_mat

DT = 0.004
FLYING = [name for name in robots.names() if not robots.get(name).fixed]
ARMED = [name for name in FLYING if robots.get(name).num_joints]


class Flight:
    """A robot at rest, 2 m up.

    Args:
        robot: name. level: of the actions. law, gains: of the controller. furnish: adds what else is in the world.
    """

    def __init__(
        self, robot: str, level: str = "ee_pose", *, law: str = "geometric_observer", gains: Gains | None = None,
        furnish: Callable[[mujoco.MjSpec], None] | None = None,
    ) -> None:  # fmt: skip
        self.robot = robots.get(robot)
        self.vehicle = self.robot.vehicle
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = DT
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.robot.add_to(spec)
        if furnish:
            furnish(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.controller = Controller(self.vehicle, level=level, law=law, gains=gains, dt=DT)
        self.joints, self.rotors = self.vehicle.num_joints, self.vehicle.num_rotors
        self.data.qpos[2] = 2.0
        self.data.qpos[7 : 7 + self.joints] = self.vehicle.rest_down
        self.data.act[: self.rotors] = self.vehicle.mixer[:, 2] * self.vehicle.mass * GRAVITY
        mujoco.mj_forward(self.model, self.data)

    @property
    def tool(self) -> np.ndarray:
        return self.data.site("tool").xpos

    @property
    def base(self) -> np.ndarray:
        return self.data.qpos[:3]

    @property
    def yaw(self) -> float:
        return float(2.0 * np.arctan2(self.data.qpos[6], self.data.qpos[3]))

    @property
    def tilt(self) -> float:
        """Angle between the base's z axis and the vertical, rad."""
        return float(np.arccos(np.clip(1.0 - 2.0 * (self.data.qpos[4] ** 2 + self.data.qpos[5] ** 2), -1.0, 1.0)))

    def pose(self, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """``ee_pose`` action: the present tool pose, moved by ``offset`` m; gripper open."""
        action = np.array([*(self.tool + offset), *rot6d_from_mat(self.data.site("tool").xmat), 1.0])
        return action[: self.controller.spec.size]

    def place(self) -> np.ndarray:
        """``base_joint`` action: hover here, heading 0, arm at rest."""
        return np.array([*self.base, 0.0, *self.vehicle.rest_down, 1.0])[: self.controller.spec.size]

    def fly(self, action: np.ndarray, seconds: float, force: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
        """Fly one action for a while under a constant outside force (N, world) on the base."""
        self.data.xfrc_applied[1, :3] = force
        for _ in range(round(seconds / DT)):
            qpos, qvel = self.data.qpos[: 7 + self.joints], self.data.qvel[: 6 + self.joints]
            thrust, servo = self.controller.update(action, qpos, qvel, self.data.act[: self.rotors].copy())
            self.data.ctrl[: self.rotors] = thrust
            self.data.ctrl[self.rotors : self.rotors + self.joints] = servo
            self.data.ctrl[self.rotors + self.joints :] = action[-1] * self.robot.gripper.stroke
            mujoco.mj_step(self.model, self.data)

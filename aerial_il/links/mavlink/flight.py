"""Our flight controller as the stand-in flies it: at several levels, with rotors of which nothing is measured."""

import math

import numpy as np

from aerial_il.control import controller_state as layout
from aerial_il.control.controller import Controller
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.links.mavlink.channels import RotorLag
from aerial_il.links.mavlink.estimator import Estimate
from aerial_il.links.mavlink.frames import yaw_of
from aerial_il.links.mavlink.protocol import LEVELS
from aerial_il.suite.timing import PHYSICS_DT_S, SUBSTEPS

SPIN_UP_S, SPIN_UP_SHARE = 0.3, 0.8  # before it takes off: share of the weight


class Flight:
    """Our flight controller at several levels, between which it changes in the air.

    Args:
        vehicle: nominal model. law: name of the flight law.
    """

    def __init__(self, vehicle: Vehicle, law: str = "geometric_observer") -> None:
        self._vehicle, self._lag = vehicle, RotorLag(vehicle, PHYSICS_DT_S)
        self._controllers = {level: Controller(vehicle, level=level, law=law) for level in LEVELS}
        self._hover = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
        self.stop()
        now = Estimate(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
        for level in LEVELS:  # compiled before time counts
            self.fly(level, np.zeros(4), now, vehicle.rest_down, 1.0, vehicle.rest_down, np.zeros(vehicle.num_joints))
        self.stop()

    def stop(self) -> None:
        """Forget the flight."""
        for controller in self._controllers.values():
            controller.reset()
        self._level, self._spinning = "base_joint", round(SPIN_UP_S / PHYSICS_DT_S)
        self._asked: np.ndarray | None = None
        self._reference, self._steps_left = np.zeros(4), 0
        self._lag.thrust = np.zeros(self._vehicle.num_rotors)

    @property
    def joints(self) -> np.ndarray:
        """(J,) set points of the servos, rad."""
        first = layout.JOINT_CMD
        return self._controllers[self._level].state[first : first + self._vehicle.num_joints]

    def fly(
        self,
        level: str,
        base: np.ndarray,
        now: Estimate,
        posture: np.ndarray,
        opening: float,
        joints: np.ndarray,
        speeds: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return thrusts (R,) N and joint set points (J,) rad for the next 4 ms.

        Args:
            level: of ``LEVELS``. base: (4,) what it asks of the base. now: the estimate.
            posture, opening: set points of arm and gripper. joints, speeds: (J,) of the arm, as measured.
        """
        if self._spinning:
            self._spinning -= 1
            thrust, held = SPIN_UP_SHARE * self._hover, joints
        else:
            self._change(level, now)
            controller = self._controllers[level]
            arm = self._rates_to(posture) if level == "velocity" else posture
            grip = [opening] if self._vehicle.gripper_stroke else []
            action = np.array([*(self._between(base) if level == "base_joint" else base), *arm, *grip])
            qpos = np.concatenate([now.pos, now.quat, joints])
            qvel = np.concatenate([now.vel, now.angvel, speeds])
            thrust, _ = controller.update(action, qpos, qvel, self._lag.thrust)
            held = self.joints
        self._lag.follow(thrust)
        return thrust, held

    def _between(self, base: np.ndarray) -> np.ndarray:
        """Return where on the way from the last set point of the base to the newest it is to be, in steps of 4 ms.

        They come every 20 ms: a reference that jumped to each would move in jerks.
        """
        if self._asked is None:
            self._asked = self._reference = base
        if not np.array_equal(base, self._asked):
            self._asked, self._steps_left = base, SUBSTEPS
        if self._steps_left:
            ahead = base - self._reference
            ahead[3] = math.remainder(ahead[3], 2.0 * math.pi)
            self._reference = self._reference + ahead / self._steps_left
            self._steps_left -= 1
        return self._reference

    def _rates_to(self, posture: np.ndarray) -> np.ndarray:
        speed = self._vehicle.joint_speed
        return np.clip((posture - self.joints) / (PHYSICS_DT_S * SUBSTEPS), -speed, speed)

    def _change(self, level: str, now: Estimate) -> None:
        """Go on at another level, the base's reference where the base is."""
        if level == self._level:
            return
        state = self._controllers[level].state
        state[:] = self._controllers[self._level].state
        state[layout.BASE_POS : layout.BASE_POS + 3], state[layout.BASE_YAW] = now.pos, yaw_of(now.quat)
        state[layout.BASE_VEL : layout.BASE_VEL + 3], state[layout.BASE_YAW_RATE] = now.vel, 0.0
        self._level, self._asked = level, None

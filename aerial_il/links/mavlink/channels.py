"""What the 16 numbers of HIL_ACTUATOR_CONTROLS and those of MAV_CMD_DO_SET_ACTUATOR mean to a vehicle.

Rotors come first, from 0 to 1; then the arm's joints, from -1 to 1 over their ranges; then the gripper, -1 closed.
"""

import math

import numpy as np

from aerial_il.control.vehicle import Vehicle
from aerial_il.core.errors import InvalidValueError

CHANNELS = 16
THRUST_CURVE = 0.3  # PX4's THR_MDL_FAC


class Channels:
    """Thrusts, joint positions and opening as normalised numbers.

    Args:
        vehicle: nominal model. curve: share of a rotor's thrust that grows with the square of its control; the rest
            grows with the control itself (PX4's THR_MDL_FAC).

    Raises:
        InvalidValueError: the vehicle needs more channels than there are, or has reversible rotors.
    """

    def __init__(self, vehicle: Vehicle, curve: float = THRUST_CURVE) -> None:
        self._vehicle, self._curve = vehicle, curve
        self.rotors, self.joints = vehicle.num_rotors, vehicle.num_joints
        self.grips = vehicle.gripper_stroke > 0.0
        needed = self.rotors + self.joints + self.grips
        if needed > CHANNELS or (vehicle.rotor_min < 0.0).any():
            raise InvalidValueError(
                f"{self.rotors} rotors and {self.joints} joints: HIL_ACTUATOR_CONTROLS flies robots of {CHANNELS} "
                "channels at most, whose rotors turn one way."
            )

    def controls(self, thrust: np.ndarray, joints: np.ndarray, opening: float) -> np.ndarray:
        """(16,) controls for thrusts (R,) N, joint positions (J,) rad and an opening in [0, 1]."""
        share, curve = np.clip(thrust / self._vehicle.rotor_max, 0.0, 1.0), self._curve
        if curve:
            share = (np.sqrt((1.0 - curve) ** 2 + 4.0 * curve * share) - (1.0 - curve)) / (2.0 * curve)
        controls = np.zeros(CHANNELS)
        arm = self.actuators(joints, opening)
        controls[: self.rotors], controls[self.rotors : self.rotors + arm.size] = share, arm
        return controls

    def thrust(self, controls: np.ndarray) -> np.ndarray:
        """(R,) thrusts, N."""
        share = np.clip(controls[: self.rotors], 0.0, 1.0)
        return self._vehicle.rotor_max * (self._curve * share**2 + (1.0 - self._curve) * share)

    def arm(self, controls: np.ndarray) -> np.ndarray:
        """(J + 1,) or (J,) joint positions, rad, and the opening, of the channels behind the rotors'."""
        return self.posture(controls[self.rotors : self.rotors + self.joints + self.grips])

    def actuators(self, joints: np.ndarray, opening: float) -> np.ndarray:
        """(J + 1,) or (J,) numbers in [-1, 1] of joint positions (J,) rad and an opening in [0, 1]."""
        low, high = self._vehicle.joint_low, self._vehicle.joint_high
        arm = (2.0 * joints - low - high) / (high - low)
        return np.clip([*arm, 2.0 * opening - 1.0] if self.grips else arm, -1.0, 1.0)

    def posture(self, actuators: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`actuators`: joint positions, rad, then the opening where there is a gripper."""
        low, high = self._vehicle.joint_low, self._vehicle.joint_high
        actuators = np.clip(actuators, -1.0, 1.0)
        joints = 0.5 * (low + high + (high - low) * actuators[: self.joints])
        return np.array([*joints, 0.5 * (1.0 + actuators[-1])]) if self.grips else joints


class RotorLag:
    """Thrusts that follow their commands as a vehicle's rotors do, in steps of ``dt`` s.

    Attributes:
        thrust: (R,) N, now.
    """

    def __init__(self, vehicle: Vehicle, dt: float) -> None:
        self._low, self._high = vehicle.rotor_min, vehicle.rotor_max
        self._rising = 1.0 - math.exp(-dt / vehicle.rotor_tau_up)
        self._falling = 1.0 - math.exp(-dt / vehicle.rotor_tau_down)
        self.thrust = np.zeros(vehicle.num_rotors)

    def follow(self, command: np.ndarray) -> None:
        """Go on towards commands (R,), N."""
        gap = np.clip(command, self._low, self._high) - self.thrust
        self.thrust = self.thrust + np.where(gap >= 0.0, self._rising, self._falling) * gap

"""What the stand-in autopilot is about: it takes commands and set points, and says what is to be flown now.

Modes, results and masks are MAVLink's and PX4's; where a command is refused, STATUSTEXT says why.
"""

import math
from typing import Any

import numpy as np

from aerial_il.control.vehicle import Vehicle
from aerial_il.links.link import QUIET_S, Mode
from aerial_il.links.mavlink.channels import Channels
from aerial_il.links.mavlink.estimator import Estimate
from aerial_il.links.mavlink.frames import Home, yaw_of
from aerial_il.links.mavlink.protocol import AUTO, LOITER, OFFBOARD
from aerial_il.links.mavlink.setpoints import PER_MESSAGE, Wanted, read_setpoint
from aerial_il.links.mavlink.wire import dialect
from aerial_il.links.robot import ABOVE_M, ARRIVED_M, HIGHEST_M, IN_CRADLE_M, SLOW_M_S, TAKE_OFF_M


class Commander:
    """Modes and set points of one vehicle.

    Args:
        vehicle: nominal model. channels: its arm as actuators. home: where the world's origin is.
        quiet_s: without a set point for longer, it holds.

    Attributes:
        mode: what it is about. armed: whether rotors may turn. joints, opening: set points of the arm.
    """

    def __init__(self, vehicle: Vehicle, channels: Channels, home: Home, quiet_s: float = QUIET_S) -> None:
        self._channels, self._home, self._quiet_s = channels, home, quiet_s
        self._lift = float(vehicle.rotor_max @ vehicle.rotor_axis[:, 2])
        self.mode, self.armed = Mode.STANDING, False
        self.joints, self.opening = np.zeros(vehicle.num_joints), 1.0
        self._now: Estimate | None = None
        self._time_s = self._heard_s = 0.0
        self._setpoint: Wanted | None = None
        self._cradle: tuple[np.ndarray, float, np.ndarray] | None = None
        self._target = np.zeros(4)

    def know(self, time_s: float, estimate: Estimate, joints: np.ndarray, opening: float) -> None:
        """Take note of the time and of how the vehicle stands."""
        self._time_s, self._now = time_s, estimate
        if self.mode is Mode.STANDING:
            self.joints, self.opening = joints, opening

    def obey(self, message: Any) -> list[Any]:
        """Take a message of whoever commands; return what is to be answered."""
        name = message.get_type()
        if name == "COMMAND_LONG":
            return self._obey_command(message)
        if name in ("SET_POSITION_TARGET_LOCAL_NED", "SET_ATTITUDE_TARGET"):
            problem = self._follow(message)
            return [_text(f"Set point refused: {problem}")] if problem else []
        return []

    def wanted(self) -> Wanted | None:
        """Return what to fly in this tick; None while it stands."""
        now = self._now
        if now is None or self.mode is Mode.STANDING:
            return None
        if self.mode is Mode.FLYING:
            if self._setpoint is not None and not self._quiet:
                return self._setpoint
            self._hold(now)
        if self.mode is Mode.TAKING_OFF and np.linalg.norm(now.pos - self._target[:3]) < ARRIVED_M:
            self.mode = Mode.HOLDING
        if self.mode is Mode.LANDING:
            self._lower(now)
        return None if self.mode is Mode.STANDING else ("base_joint", self._target)

    @property
    def _quiet(self) -> bool:
        return self._time_s - self._heard_s > self._quiet_s

    def _obey_command(self, message: Any) -> list[Any]:
        common = dialect()
        numbers = [getattr(message, f"param{k}") for k in range(1, 8)]
        obeyed = {
            common.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            common.MAV_CMD_NAV_TAKEOFF: self._take_off,
            common.MAV_CMD_NAV_LAND: self._land,
            common.MAV_CMD_DO_SET_MODE: self._set_mode,
            common.MAV_CMD_DO_SET_ACTUATOR: self._move_arm,
            common.MAV_CMD_DO_GRIPPER: self._grip,
        }.get(message.command)
        problem = "" if obeyed is None or self._now is None else obeyed(numbers, self._now)
        if obeyed is None:
            result, problem = common.MAV_RESULT_UNSUPPORTED, f"Command {message.command} is not known."
        elif self._now is None:
            result, problem = common.MAV_RESULT_TEMPORARILY_REJECTED, "The estimator has not begun yet."
        else:
            result = common.MAV_RESULT_DENIED if problem else common.MAV_RESULT_ACCEPTED
        answer = common.MAVLink_command_ack_message(message.command, result)
        return [_text(problem), answer] if problem else [answer]

    def _arm(self, numbers: list[float], now: Estimate) -> str:
        if numbers[0] < 0.5 and self.mode is not Mode.STANDING:
            return "It is in the air: land first."
        self.armed = numbers[0] >= 0.5
        return ""

    def _take_off(self, numbers: list[float], now: Estimate) -> str:
        if self.mode is not Mode.STANDING:
            return "It is in the air already."
        if not self.armed:
            return "It is not armed."
        height = TAKE_OFF_M if math.isnan(numbers[6]) else numbers[6] - self._home.alt_m - now.pos[2]
        if not -ARRIVED_M <= height <= HIGHEST_M:
            return f"It takes off by 0 to {HIGHEST_M:g} m, not {height:.2f}."
        if self._cradle is None:
            self._cradle = now.pos, yaw_of(now.quat), self.joints
        self._hold(now)
        self.mode = Mode.TAKING_OFF
        self._target[2] += max(0.0, height)
        return ""

    def _land(self, numbers: list[float], now: Estimate) -> str:
        if self.mode is Mode.STANDING:
            return "It stands."
        self.mode = Mode.LANDING
        return ""

    def _set_mode(self, numbers: list[float], now: Estimate) -> str:
        main, sub = int(numbers[1]), int(numbers[2])
        if self.mode in (Mode.STANDING, Mode.TAKING_OFF):
            return "It does not fly yet."
        if main == OFFBOARD:
            if self._setpoint is None or self._quiet:
                return "Offboard needs a stream of set points first."
            self.mode = Mode.FLYING
        elif (main, sub) == (AUTO, LOITER):
            self._hold(now)
        else:
            return f"Mode {main}, {sub} is not known; 6 is offboard, 4, 3 holds."
        return ""

    def _move_arm(self, numbers: list[float], now: Estimate) -> str:
        first = PER_MESSAGE * int(numbers[6])
        actuators = self._channels.actuators(self.joints, self.opening)
        for k, value in enumerate(numbers[:PER_MESSAGE], start=first):
            if k < actuators.size and math.isfinite(value):
                actuators[k] = value
        posture = self._channels.posture(actuators)
        self.joints = posture[: self.joints.size]
        self.opening = float(posture[-1]) if self._channels.grips else 1.0
        return ""

    def _grip(self, numbers: list[float], now: Estimate) -> str:
        if not self._channels.grips:
            return "It has no gripper."
        self.opening = 1.0 if numbers[1] == dialect().GRIPPER_ACTION_RELEASE else 0.0
        return ""

    def _follow(self, message: Any) -> str:
        """Take note of a set point; return why it is refused, or nothing."""
        if self._now is None:
            return "the estimator has not begun yet."
        wanted, problem = read_setpoint(message, yaw_of(self._now.quat), self._lift)
        if wanted is not None:
            self._setpoint, self._heard_s = wanted, self._time_s
        return problem

    def _hold(self, now: Estimate) -> None:
        self.mode, self._setpoint = Mode.HOLDING, None
        self._target = np.array([*now.pos, yaw_of(now.quat)])

    def _lower(self, now: Estimate) -> None:
        """Lead back into the cradle: over it first, then down; there, stand."""
        assert self._cradle is not None
        pos, yaw, self.joints = self._cradle
        if np.linalg.norm(now.pos - pos) < IN_CRADLE_M and np.linalg.norm(now.vel) < SLOW_M_S:
            self.mode, self.armed = Mode.STANDING, False
            return
        aside = float(np.linalg.norm(now.pos[:2] - pos[:2]))
        above = max(pos[2] + ABOVE_M, now.pos[2] if aside > ABOVE_M else 0.0)
        self._target = np.array([*pos[:2], above if aside > ARRIVED_M else pos[2], yaw])


def _text(text: str) -> Any:
    common = dialect()
    return common.MAVLink_statustext_message(common.MAV_SEVERITY_WARNING, text.encode()[:50])

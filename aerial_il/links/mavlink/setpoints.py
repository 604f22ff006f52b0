"""Set points on the wire: how a client writes them, and how an autopilot reads them.

A base's four numbers are those with which an action begins: position and heading, velocity and yaw rate, or thrust and
body rates.
"""

import math
from typing import Any

import numpy as np

from aerial_il.control.actions import MAX_YAW_RATE
from aerial_il.links.mavlink.channels import Channels
from aerial_il.links.mavlink.frames import swap_body, swap_world, swap_yaw
from aerial_il.links.mavlink.protocol import AUTOPILOT
from aerial_il.links.mavlink.wire import dialect

LOCAL_NED = 1
NO_POSITION, NO_VELOCITY, NO_ACCELERATION, NO_YAW, NO_YAW_RATE = 0x7, 0x38, 0x1C0, 0x400, 0x800
NO_RATES, NO_THRUST, NO_ATTITUDE = 0x7, 0x40, 0x80  # of SET_ATTITUDE_TARGET
PER_MESSAGE = 6  # actuators in a MAV_CMD_DO_SET_ACTUATOR
TURNING = 2.0  # 1/s: how fast a heading is approached that comes with a velocity
NOTHING = (0.0, 0.0, 0.0)

Wanted = tuple[str, np.ndarray]  # level, and the base's four numbers at that level


def setpoint_message(level: str, base: np.ndarray, lift: float, time_ms: int) -> Any:
    """The message of a set point.

    Args:
        level: ``base_joint``, ``velocity`` or ``ctbr``. base: (4,). lift: N, of all rotors at most.
    """
    if level == "ctbr":
        rates, thrust = map(float, swap_body(base[1:])), float(base[0]) / lift
        return dialect().MAVLink_set_attitude_target_message(
            time_ms, *AUTOPILOT, NO_ATTITUDE, [1.0, 0.0, 0.0, 0.0], *rates, thrust
        )
    vector = tuple(map(float, swap_world(base[:3])))
    if level == "velocity":
        mask, vectors = NO_POSITION | NO_ACCELERATION | NO_YAW, (*NOTHING, *vector, *NOTHING)
        turn = 0.0, -float(base[3])
    else:
        mask, vectors = NO_VELOCITY | NO_ACCELERATION | NO_YAW_RATE, (*vector, *NOTHING, *NOTHING)
        turn = swap_yaw(float(base[3])), 0.0
    return dialect().MAVLink_set_position_target_local_ned_message(
        time_ms, *AUTOPILOT, LOCAL_NED, mask, *vectors, *turn
    )


def read_setpoint(message: Any, heading: float, lift: float) -> tuple[Wanted | None, str]:
    """The set point of a message, or why it is refused.

    Args:
        heading: rad, of the vehicle; kept where the message says none. lift: N, of all rotors at most.
    """
    read = _rates if message.get_type() == "SET_ATTITUDE_TARGET" else _motion
    wanted = read(message, heading, lift)
    if wanted is None:
        return None, "frame or mask is not flown here."
    if not np.isfinite(wanted[1]).all():
        return None, "a number is not finite."
    return wanted, ""


def actuator_messages(channels: Channels, joints: np.ndarray, opening: float) -> list[Any]:
    """Commands that set the arm's joints (J,), rad, and the gripper: six a message."""
    values = channels.actuators(joints, opening).tolist()
    values += [math.nan] * (-len(values) % PER_MESSAGE)
    return [
        command_message("MAV_CMD_DO_SET_ACTUATOR", *values[k : k + PER_MESSAGE], k // PER_MESSAGE)
        for k in range(0, len(values), PER_MESSAGE)
    ]


def command_message(name: str, *numbers: float, confirmation: int = 0) -> Any:
    """COMMAND_LONG of a command by name, with up to seven numbers, the rest zero; sent so often before."""
    seven = [*map(float, numbers), *[0.0] * 7][:7]
    return dialect().MAVLink_command_long_message(*AUTOPILOT, getattr(dialect(), name), min(confirmation, 255), *seven)


def _rates(message: Any, heading: float, lift: float) -> Wanted | None:
    if message.type_mask & (NO_RATES | NO_THRUST):
        return None
    rates = swap_body(np.array([message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate]))
    return "ctbr", np.array([lift * message.thrust, *rates])


def _motion(message: Any, heading: float, lift: float) -> Wanted | None:
    mask = message.type_mask
    yaw = heading if mask & NO_YAW else 0.5 * math.pi - message.yaw
    if message.coordinate_frame != LOCAL_NED:
        return None
    if not mask & NO_POSITION:
        where = swap_world(np.array([message.x, message.y, message.z]))
        return "base_joint", np.array([*where, math.remainder(yaw, 2.0 * math.pi) if math.isfinite(yaw) else yaw])
    if not mask & NO_VELOCITY:
        rate = 0.0 if mask & NO_YAW_RATE else -message.yaw_rate
        if not mask & NO_YAW and math.isfinite(yaw):
            gap = math.remainder(yaw - heading, 2.0 * math.pi)
            rate += min(max(TURNING * gap, -MAX_YAW_RATE), MAX_YAW_RATE)
        return "velocity", np.array([*swap_world(np.array([message.vx, message.vy, message.vz])), rate])
    return None

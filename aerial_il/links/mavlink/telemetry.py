"""How a vehicle stands, on the wire: how an autopilot writes it, and how a client reads it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.links.link import LinkError, Mode
from aerial_il.links.mavlink.frames import swap_attitude, swap_body, swap_world, yaw_of
from aerial_il.links.mavlink.protocol import AUTO, AUTOPILOT, LOITER, OFFBOARD, joints_message, joints_of
from aerial_il.links.mavlink.wire import dialect

LATE_S = 1.0  # a datagram may be so late; a clock that is further back has jumped


@dataclass(frozen=True)
class VehicleState:
    """How a vehicle stands by its own estimate.

    Attributes:
        stamp: s, by its clock. pos, vel: (3,) world, m and m/s. quat: (4,) w, x, y, z, world from base.
        angvel: (3,) base axes, rad/s. joints, joint_vel: (J,) rad and rad/s. opening: of the gripper, 0 to 1.
        armed: whether rotors may turn. mode: see :class:`~aerial_il.links.link.Mode`.
    """

    stamp: float
    pos: np.ndarray
    vel: np.ndarray
    quat: np.ndarray
    angvel: np.ndarray
    joints: np.ndarray
    joint_vel: np.ndarray
    opening: float
    armed: bool
    mode: Mode

    @property
    def flying(self) -> bool:
        """Whether it is in the air."""
        return self.mode is not Mode.STANDING

    @property
    def heading(self) -> float:
        """Of its x axis from the world's, rad."""
        return yaw_of(self.quat)


def state_messages(state: VehicleState) -> list[Any]:
    """Messages of a state, of which LOCAL_POSITION_NED is the last."""
    common, us = dialect(), round(1e6 * state.stamp)
    turned = map(float, [*swap_attitude(state.quat), *swap_body(state.angvel)])
    moved = map(float, [*swap_world(state.pos), *swap_world(state.vel)])
    return [
        common.MAVLink_attitude_quaternion_message(us // 1000, *turned),
        joints_message(us, state.joints, state.joint_vel, state.opening),
        common.MAVLink_local_position_ned_message(us // 1000, *moved),
    ]


def mode_messages(state: VehicleState, rotors: int) -> list[Any]:
    """HEARTBEAT and EXTENDED_SYS_STATE of a state."""
    common = dialect()
    base = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    base |= common.MAV_MODE_FLAG_SAFETY_ARMED if state.armed else 0
    custom = OFFBOARD << 16 if state.mode is Mode.FLYING else AUTO << 16 | LOITER << 24
    status = common.MAV_STATE_ACTIVE if state.flying else common.MAV_STATE_STANDBY
    kind = common.MAV_TYPE_HEXAROTOR if rotors == 6 else common.MAV_TYPE_QUADROTOR
    landed = {mode: said for said, mode in _landed().items()}.get(state.mode, common.MAV_LANDED_STATE_IN_AIR)
    return [
        common.MAVLink_heartbeat_message(kind, common.MAV_AUTOPILOT_GENERIC, base, custom, status, 3),
        common.MAVLink_extended_sys_state_message(common.MAV_VTOL_STATE_UNDEFINED, landed),
    ]


NEEDED, LOCAL = ("HEARTBEAT", "EXTENDED_SYS_STATE", "ATTITUDE_QUATERNION"), "LOCAL_POSITION_NED"


class Reader:
    """Puts the messages of an autopilot together.

    Args:
        joints: of the arm. lockstep: whether no message can overtake another.

    Attributes:
        state: the newest complete one. text: what STATUSTEXT said last. question: the last TIMESYNC that asks.
    """

    def __init__(self, joints: int, *, lockstep: bool) -> None:
        self._joints, self._late_s = joints, 0.0 if lockstep else LATE_S
        self._parts: dict[str, Any] = {}
        self._arm = (np.zeros(0), np.zeros(0), 1.0) if joints == 0 else None
        self.state: VehicleState | None = None
        self.text, self.question = "", None

    @property
    def lacking(self) -> list[str]:
        """Names of the messages that a state takes and that have not come yet."""
        arm = [] if self._arm is not None else ["joints of the arm"]
        return [name for name in (*NEEDED, LOCAL) if name not in self._parts] + arm

    def take(self, message: Any) -> None:
        """Take a message.

        Raises:
            LinkError: the autopilot's clock jumped back.
        """
        if (message.get_srcSystem(), message.get_srcComponent()) != AUTOPILOT:
            return
        name = message.get_type()
        self._parts[name] = message
        self._arm = joints_of(message, self._joints) or self._arm
        if name == "TIMESYNC" and message.tc1 == 0:
            self.question = message
        elif name == "STATUSTEXT":
            self.text = message.text
        elif name == LOCAL:
            self._gather(message)

    def _gather(self, local: Any) -> None:
        stamp, before = 1e-3 * local.time_boot_ms, -math.inf if self.state is None else self.state.stamp
        if stamp < before - self._late_s:
            raise LinkError(f"The autopilot's clock jumped back, from {before:.3f} to {stamp:.3f} s.")
        if stamp <= before or self._arm is None or self.lacking:
            return
        beat, landed, turned = (self._parts[name] for name in NEEDED)
        offboard = beat.custom_mode >> 16 & 0xFF == OFFBOARD
        joints, speeds, opening = self._arm
        self.state = VehicleState(
            stamp=stamp,
            pos=swap_world(np.array([local.x, local.y, local.z])),
            vel=swap_world(np.array([local.vx, local.vy, local.vz])),
            quat=swap_attitude(np.array([turned.q1, turned.q2, turned.q3, turned.q4])),
            angvel=swap_body(np.array([turned.rollspeed, turned.pitchspeed, turned.yawspeed])),
            joints=joints,
            joint_vel=speeds,
            opening=opening,
            armed=bool(beat.base_mode & dialect().MAV_MODE_FLAG_SAFETY_ARMED),
            mode=_landed().get(landed.landed_state, Mode.FLYING if offboard else Mode.HOLDING),
        )


def _landed() -> dict[int, Mode]:
    """EXTENDED_SYS_STATE.landed_state of the modes that it tells."""
    common = dialect()
    return {
        common.MAV_LANDED_STATE_ON_GROUND: Mode.STANDING,
        common.MAV_LANDED_STATE_TAKEOFF: Mode.TAKING_OFF,
        common.MAV_LANDED_STATE_LANDING: Mode.LANDING,
    }

"""An offboard client: a robot behind an autopilot as one commands it from a companion computer, in our frames.

It streams the set points that it is given and answers the autopilot's TIMESYNC, which is what the stand-in autopilot
waits for in lockstep. It has flown the stand-in; no PX4 and no hardware has been flown with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec, check_level
from aerial_il.links.link import LinkError, Mode, RefusedError
from aerial_il.links.mavlink.autopilot import CLIENT_PORT, LEVELS
from aerial_il.links.mavlink.channels import Channels
from aerial_il.links.mavlink.commander import (
    AUTO,
    LOCAL_NED,
    LOITER,
    NO_POSITION,
    NO_VELOCITY,
    NO_YAW,
    NO_YAW_RATE,
    OFFBOARD,
    PER_MESSAGE,
)
from aerial_il.links.mavlink.frames import Home, swap_attitude, swap_body, swap_world, swap_yaw, yaw_of
from aerial_il.links.mavlink.simulator import AUTOPILOT, joints_of
from aerial_il.links.mavlink.wire import PATIENCE_S, Wire, connect, datagrams, dialect
from aerial_il.suite.timing import CONTROL_DT_S

COMPANION = (1, 191)  # system and component
NO_ACCELERATION, NO_ATTITUDE = 0x1C0, 0x80
WITHIN_M, WITHIN_RAD = 0.06, 0.06
TIMEOUT_S = 30.0
REBOOTED_S = 1.0  # a clock that is further back than a datagram may be late


@dataclass(frozen=True)
class VehicleState:
    """How the vehicle stands by its own estimate.

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


class OffboardClient:
    """Commands one robot.

    Args:
        robot: registry name. host, port: in lockstep, where the autopilot serves (TCP); else, where this listens (UDP).
        lockstep: time waits for :meth:`step`. home: where the world's origin is, as the autopilot has it.
        patience_s: with the autopilot.

    Raises:
        InvalidValueError: pymavlink is missing. LinkError: the port is in use, or there is no autopilot.
    """

    def __init__(
        self,
        robot: str,
        *,
        host: str = "127.0.0.1",
        port: int = CLIENT_PORT,
        lockstep: bool = False,
        home: Home | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        dialect()
        self._vehicle, self.robot, self.lockstep = robots.get(robot).vehicle, robot, lockstep
        self._channels, self._home = Channels(self._vehicle), home or Home()
        self._lift = float(self._vehicle.rotor_max @ self._vehicle.rotor_axis[:, 2])
        peer = "The autopilot"
        opened = connect(host, port, peer) if lockstep else datagrams(host, port)
        self.port: int = port if lockstep else opened.getsockname()[1]
        self._wire = Wire(opened, *COMPANION, peer, patience_s)
        self._parts: dict[str, Any] = {}
        self._state: VehicleState | None = None
        self._echo: Any = None
        self._text = ""
        self._held = False
        self._joints, self._opening, self._sent_s = np.zeros(0), 1.0, -math.inf

    @property
    def state(self) -> VehicleState:
        """How the vehicle stood when it last said so.

        Raises:
            LinkError: it has not said so yet; :meth:`connect` waits for it.
        """
        if self._state is None:
            raise LinkError("The autopilot has told nothing yet: connect() first.")
        return self._state

    def connect(self) -> VehicleState:
        """Wait for the first state, and return it."""
        while self._state is None:
            self.step()
        self._joints, self._opening = self._state.joints, self._state.opening
        return self._state

    def step(self) -> VehicleState | None:
        """Let time go on to the next state (20 ms), and return it; None as long as the first is not complete.

        Raises:
            LinkError: the autopilot is gone or silent, or its clock jumps back.
        """
        self._answer()
        for message in self._wire.wait_for("TIMESYNC"):
            self._take(message)
        self._gather()
        if not self.lockstep:
            self._answer()
        return self._state

    def poll(self) -> VehicleState | None:
        """Take what has come, without waiting; return the newest state."""
        for message in self._wire.poll():
            self._take(message)
            if message.get_type() == "TIMESYNC":
                self._gather()
                if not self.lockstep:
                    self._answer()
        return self._state

    def send(self, level: str, action: np.ndarray) -> None:
        """Let the vehicle follow a set point from now on; again within 0.2 s, or it hovers.

        Args:
            level: ``base_joint``, ``velocity`` or ``ctbr``. action: (Da,) as
                :func:`aerial_il.control.actions.action_spec` has it; clipped to its bounds.

        Raises:
            RefusedError: another level or size, or not finite.
        """
        if level not in LEVELS:
            raise RefusedError(f"{level!r} is not flown over MAVLink. Valid: {', '.join(LEVELS)}.")
        check_level(ActionLevel.parse(level), self._vehicle, self.robot)
        spec, action = action_spec(ActionLevel.parse(level), self._vehicle), np.asarray(action, float)
        if action.shape != (spec.size,) or not np.isfinite(action).all():
            labels = ", ".join(spec.labels)
            raise RefusedError(f"{level} takes {spec.size} finite numbers ({labels}), got {action!r}.")
        action = spec.clip(action)
        self._move(level, action[4:])
        self._wire.send(self._setpoint(level, action[:4]), *self._actuators())
        if self.state.mode is Mode.HOLDING and not self._held:
            self._wire.send(self._command("MAV_CMD_DO_SET_MODE", 1.0, OFFBOARD))

    def order(self, what: str, **numbers: float) -> None:
        """Give an order, and return when it was taken: time does not go on in lockstep.

        Args:
            what: ``arm``, ``disarm``, ``take_off`` (``height_m`` above where it stands), ``land`` (where it took off),
                ``hover`` (until ``follow``: set points do not count meanwhile), ``follow``.

        Raises:
            RefusedError: it refuses, and says why, or there is no such order. LinkError: no answer.
        """
        self._held = what == "hover" or (self._held and what != "follow")
        if what == "follow":
            return
        height = self.state.pos[2] + numbers.get("height_m", 0.3) + self._home.alt_m
        nan = math.nan
        orders = {
            "arm": ("MAV_CMD_COMPONENT_ARM_DISARM", 1.0),
            "disarm": ("MAV_CMD_COMPONENT_ARM_DISARM", 0.0),
            "take_off": ("MAV_CMD_NAV_TAKEOFF", nan, nan, nan, nan, nan, nan, height),
            "land": ("MAV_CMD_NAV_LAND", nan, nan, nan, nan, nan, nan, nan),
            "hover": ("MAV_CMD_DO_SET_MODE", 1.0, AUTO, LOITER),
        }
        if what not in orders:
            raise RefusedError(f"{what!r} is no order. Valid: {', '.join([*orders, 'follow'])}.")
        self.command(*orders[what])

    def command(self, name: str, *numbers: float) -> None:
        """Send a MAV_CMD by name with up to seven numbers, and wait for its acknowledgement.

        Raises:
            RefusedError: it is not accepted.
        """
        common = dialect()
        self._text = ""
        self._wire.send(self._command(name, *numbers))
        while True:
            message = self._wire.receive()
            self._take(message)
            if message.get_type() == "COMMAND_ACK" and message.command == getattr(common, name):
                break
        if message.result != common.MAV_RESULT_ACCEPTED:
            result = common.enums["MAV_RESULT"][message.result].name
            raise RefusedError(f"The autopilot answers {name} with {result}. {self._text}".rstrip())

    def close(self) -> None:
        """Hang up."""
        self._wire.close()

    def arm(self) -> None:
        """Let the rotors turn."""
        self.order("arm")

    def take_off(self, height_m: float = 0.3) -> None:
        """Rise by a height, and hover."""
        self.order("take_off", height_m=height_m)
        self._wait(lambda state: state.mode is Mode.HOLDING, f"take off by {height_m:g} m")

    def go_to(self, pos: Sequence[float], heading: float | None = None, *, timeout_s: float = TIMEOUT_S) -> None:
        """Fly to a position (3,) m, with a heading in rad (None: as it is), until it is there and slow."""
        target = np.asarray(pos, float)
        yaw = self.state.heading if heading is None else heading
        action = self._action([*target, yaw], self._joints)
        self._wait(
            lambda state: bool(
                np.linalg.norm(state.pos - target) < WITHIN_M
                and abs(math.remainder(state.heading - yaw, 2.0 * math.pi)) < WITHIN_RAD
                and np.linalg.norm(state.vel) < WITHIN_M
            ),
            f"go to {target.round(2).tolist()}",
            lambda: self.send("base_joint", action),
            timeout_s,
        )

    def velocity(self, vel: Sequence[float], yaw_rate: float = 0.0, *, seconds: float = CONTROL_DT_S) -> None:
        """Fly at a velocity (3,) m/s, world, turning at a rate, rad/s."""
        action = self._action([*vel, yaw_rate], np.zeros(self._joints.size))
        self._for(seconds, lambda: self.send("velocity", action))

    def rates(self, thrust: float, rates: Sequence[float], *, seconds: float = CONTROL_DT_S) -> None:
        """Fly with a collective thrust, N, and body rates (3,), rad/s."""
        action = self._action([thrust, *rates], self._joints)
        self._for(seconds, lambda: self.send("ctbr", action))

    def move_arm(self, joints: Sequence[float], *, timeout_s: float = TIMEOUT_S) -> None:
        """Move the arm's joints (J,), rad, while the base hovers, until they are there."""
        target = np.asarray(joints, float)
        state = self.state
        action = self._action([*state.pos, state.heading], target)
        self._wait(
            lambda state: bool(np.abs(state.joints - target).max(initial=0.0) < WITHIN_RAD),
            f"move the arm to {target.round(2).tolist()}",
            lambda: self.send("base_joint", action),
            timeout_s,
        )

    def grip(self, opening: float, *, seconds: float = 1.0) -> None:
        """Open the gripper (1) or close it (0), or anything between, and let it happen."""
        self._opening = float(opening)
        if opening in (0.0, 1.0):
            release = dialect().GRIPPER_ACTION_RELEASE if opening else dialect().GRIPPER_ACTION_GRAB
            self.command("MAV_CMD_DO_GRIPPER", 1.0, release)
        else:
            self._wire.send(*self._actuators())
        self._for(seconds, lambda: None)

    def land(self) -> None:
        """Land where it took off, and wait until it stands."""
        self.order("land")
        self._wait(lambda state: not state.flying, "land")

    def _wait(
        self,
        done: Callable[[VehicleState], bool],
        what: str,
        before: Callable[[], None] = lambda: None,
        timeout_s: float = TIMEOUT_S,
    ) -> None:
        """Step until something is done; time runs by the vehicle's clock."""
        until = self.state.stamp + timeout_s
        while not done(self.state):
            if self.state.stamp > until:
                raise LinkError(
                    f"It did not {what} within {timeout_s:g} s: it is at {self.state.pos.round(2).tolist()}."
                )
            before()
            self.step()

    def _for(self, seconds: float, before: Callable[[], None]) -> None:
        until = self.state.stamp + seconds - 0.5 * CONTROL_DT_S
        while self.state.stamp < until:
            before()
            self.step()

    def _action(self, base: Sequence[float], joints: np.ndarray) -> np.ndarray:
        return np.array([*base, *joints, *([self._opening] if self._channels.grips else [])])

    def _move(self, level: str, arm: np.ndarray) -> None:
        """Take note of the arm's part of an action; speeds count for as long as set points are apart."""
        count = self._vehicle.num_joints
        if self._joints.size != count:
            self._joints = self.state.joints
        stamp = self.state.stamp
        if level == "velocity":
            apart = min(max(stamp - self._sent_s, 0.0), 5.0 * CONTROL_DT_S)
            moved = self._joints + (apart or CONTROL_DT_S) * arm[:count]
            self._joints = np.clip(moved, self._vehicle.joint_low, self._vehicle.joint_high)
        else:
            self._joints = arm[:count]
        self._sent_s = stamp
        if self._channels.grips:
            self._opening = float(arm[count])

    def _setpoint(self, level: str, base: np.ndarray) -> Any:
        common, ms, nothing = dialect(), round(1000.0 * self.state.stamp), (0.0, 0.0, 0.0)
        if level == "ctbr":
            rates = map(float, swap_body(base[1:]))
            return common.MAVLink_set_attitude_target_message(
                ms, *AUTOPILOT, NO_ATTITUDE, [1.0, 0.0, 0.0, 0.0], *rates, float(base[0]) / self._lift
            )
        vector = tuple(map(float, swap_world(base[:3])))
        if level == "velocity":
            mask = NO_POSITION | NO_ACCELERATION | NO_YAW
            return common.MAVLink_set_position_target_local_ned_message(
                ms, *AUTOPILOT, LOCAL_NED, mask, *nothing, *vector, *nothing, 0.0, -float(base[3])
            )
        mask = NO_VELOCITY | NO_ACCELERATION | NO_YAW_RATE
        return common.MAVLink_set_position_target_local_ned_message(
            ms, *AUTOPILOT, LOCAL_NED, mask, *vector, *nothing, *nothing, swap_yaw(float(base[3])), 0.0
        )

    def _actuators(self) -> list[Any]:
        """Commands that set the arm's joints and the gripper, six a message."""
        values = self._channels.actuators(self._joints, self._opening).tolist()
        parts = [values[k : k + PER_MESSAGE] for k in range(0, len(values), PER_MESSAGE)]
        nan = [math.nan] * PER_MESSAGE
        return [
            self._command("MAV_CMD_DO_SET_ACTUATOR", *(part + nan)[:PER_MESSAGE], k) for k, part in enumerate(parts)
        ]

    def _command(self, name: str, *numbers: float) -> Any:
        common = dialect()
        seven = [*map(float, numbers), *[0.0] * 7][:7]
        return common.MAVLink_command_long_message(*AUTOPILOT, getattr(common, name), 0, *seven)

    def _answer(self) -> None:
        """Answer the autopilot's last question for the time: what was sent before is all for this tick."""
        if self._echo is not None:
            self._wire.send(dialect().MAVLink_timesync_message(self._echo.ts1, self._echo.ts1))
        self._echo = None

    def _take(self, message: Any) -> None:
        name = message.get_type()
        self._parts[name] = message
        if name == "TIMESYNC":
            self._echo = message
        elif name == "STATUSTEXT":
            self._text = message.text

    def _gather(self) -> None:
        """Put the parts of a state together."""
        needed = ("HEARTBEAT", "EXTENDED_SYS_STATE", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "DEBUG_FLOAT_ARRAY")
        if any(name not in self._parts for name in needed):
            return
        beat, landed, local, turned, encoders = (self._parts[name] for name in needed)
        stamp, before = 1e-3 * local.time_boot_ms, -math.inf if self._state is None else self._state.stamp
        if stamp < before - REBOOTED_S or (self.lockstep and stamp < before):
            raise LinkError(f"The autopilot's clock jumped back, from {before:.3f} to {stamp:.3f} s.")
        arm = joints_of(encoders, self._vehicle.num_joints)
        if stamp <= before or arm is None:
            return
        joints, joint_vel, opening = arm
        self._state = VehicleState(
            stamp=stamp,
            pos=swap_world(np.array([local.x, local.y, local.z])),
            vel=swap_world(np.array([local.vx, local.vy, local.vz])),
            quat=swap_attitude(np.array([turned.q1, turned.q2, turned.q3, turned.q4])),
            angvel=swap_body(np.array([turned.rollspeed, turned.pitchspeed, turned.yawspeed])),
            joints=joints,
            joint_vel=joint_vel,
            opening=opening,
            armed=bool(beat.base_mode & dialect().MAV_MODE_FLAG_SAFETY_ARMED),
            mode=_mode(beat, landed),
        )


def _mode(beat: Any, landed: Any) -> Mode:
    common = dialect()
    otherwise = Mode.FLYING if beat.custom_mode >> 16 & 0xFF == OFFBOARD else Mode.HOLDING
    return {
        common.MAV_LANDED_STATE_ON_GROUND: Mode.STANDING,
        common.MAV_LANDED_STATE_TAKEOFF: Mode.TAKING_OFF,
        common.MAV_LANDED_STATE_LANDING: Mode.LANDING,
    }.get(landed.landed_state, otherwise)

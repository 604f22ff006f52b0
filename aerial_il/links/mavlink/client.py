"""An offboard client: a robot behind an autopilot as one commands it from a companion computer, in our frames.

It answers the autopilot's TIMESYNC, which is what the stand-in autopilot waits for in lockstep. It has flown the
stand-in; no PX4 and no hardware has been flown with it.
"""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.links.link import LinkError, Mode, RefusedError
from aerial_il.links.mavlink.channels import Channels
from aerial_il.links.mavlink.frames import Home
from aerial_il.links.mavlink.protocol import AUTO, CLIENT_PORT, COMPANION, LEVELS, LOITER, OFFBOARD
from aerial_il.links.mavlink.setpoints import actuator_messages, command_message, setpoint_message
from aerial_il.links.mavlink.telemetry import Reader, VehicleState
from aerial_il.links.mavlink.wire import PATIENCE_S, NoAnswerError, Wire, connect, datagrams, dialect
from aerial_il.suite.timing import CONTROL_DT_S

WITHIN_M, WITHIN_RAD, SLOW_M_S = 0.06, 0.06, 0.06  # where somewhere has been reached
TIMEOUT_S, ASK_AGAIN_S = 30.0, 1.0
BEAT_EVERY = 50  # steps between two heartbeats
NAN = math.nan


class OffboardClient:
    """Commands one robot.

    Args:
        robot: registry name. host, port: in lockstep, where the autopilot serves (TCP); else, where this listens (UDP).
        lockstep: time waits for :meth:`step`. home: where the world's origin is, as the autopilot has it.
        patience_s: with the autopilot.

    Attributes:
        port: in use.

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
        vehicle = robots.get(robot).vehicle
        self._vehicle, self._channels, self._home = vehicle, Channels(vehicle), home or Home()
        self._lift = float(vehicle.rotor_max @ vehicle.rotor_axis[:, 2])
        self._specs = {level: action_spec(ActionLevel.parse(level), vehicle) for level in LEVELS}
        opened = connect(host, port, "The autopilot") if lockstep else datagrams(host, port)
        self.port: int = port if lockstep else opened.getsockname()[1]
        self._wire = Wire(opened, *COMPANION, "The autopilot", patience_s)
        self._asks_again_s = patience_s if lockstep else min(patience_s, ASK_AGAIN_S)
        self._reader = Reader(vehicle.num_joints, lockstep=lockstep)
        self._last = "TIMESYNC" if lockstep else "LOCAL_POSITION_NED"  # message of a step
        self._steps, self._held = 0, False
        self._joints, self._opening, self._sent_s = np.zeros(vehicle.num_joints), 1.0, -math.inf

    @property
    def state(self) -> VehicleState:
        """How the vehicle stood when it last said so.

        Raises:
            LinkError: it has not said so yet; :meth:`connect` waits for it.
        """
        if self._reader.state is None:
            raise LinkError("The autopilot has told nothing yet: connect() first.")
        return self._reader.state

    def connect(self) -> VehicleState:
        """Wait for the first state, and return it.

        Raises:
            LinkError: none comes.
        """
        until_s = time.monotonic() + self._wire.patience_s
        while self._reader.state is None:
            self.step()
            if self._reader.state is None and time.monotonic() > until_s:
                lacking = ", ".join(self._reader.lacking)
                raise LinkError(f"The autopilot has told no whole state for {self._wire.patience_s:g} s: no {lacking}.")
        self._joints, self._opening = self.state.joints, self.state.opening
        return self.state

    def step(self) -> None:
        """Let time go on to the next state: by 20 ms.

        Raises:
            LinkError: the autopilot is gone or silent, or its clock jumps back.
        """
        self._answer()
        for message in self._wire.wait_for(self._last):
            self._reader.take(message)

    def poll(self) -> VehicleState | None:
        """Take what has come, without waiting; return the newest state."""
        for message in self._wire.poll():
            self._reader.take(message)
        return self._reader.state

    def send(self, level: str, action: np.ndarray) -> None:
        """Let the vehicle follow a set point from now on; again within 0.2 s, or it hovers.

        Args:
            level: ``base_joint``, ``velocity`` or ``ctbr``. action: (Da,) as
                :func:`aerial_il.control.actions.action_spec` has it; clipped to its bounds.

        Raises:
            RefusedError: another level or size, or not finite.
        """
        if level not in self._specs:
            raise RefusedError(f"{level!r} is not flown over MAVLink. Valid: {', '.join(LEVELS)}.")
        spec, action = self._specs[level], np.asarray(action, float)
        if action.shape != (spec.size,) or not np.isfinite(action).all():
            raise RefusedError(f"{level} takes {spec.size} finite numbers ({', '.join(spec.labels)}), got {action}.")
        action = spec.clip(action)
        self._move(level, action[4:])
        setpoint = setpoint_message(level, action[:4], self._lift, round(1000.0 * self.state.stamp))
        self._wire.send(setpoint, *actuator_messages(self._channels, self._joints, self._opening))
        if self.state.mode is Mode.HOLDING and not self._held:
            self._wire.send(command_message("MAV_CMD_DO_SET_MODE", 1.0, OFFBOARD))

    def order(self, what: str, **numbers: float) -> None:
        """Give an order, and return when it was taken; in lockstep, time does not go on meanwhile.

        Args:
            what: ``arm``, ``disarm``, ``take_off`` (``height_m`` above where it stands), ``land`` (where it took off),
                ``hover`` (until ``follow``: set points do not count meanwhile), ``follow``.

        Raises:
            RefusedError: it refuses, and says why, or there is no such order. LinkError: no answer.
        """
        altitude = self._home.alt_m + self.state.pos[2] + numbers.get("height_m", 0.3)
        orders = {
            "arm": ("MAV_CMD_COMPONENT_ARM_DISARM", 1.0),
            "disarm": ("MAV_CMD_COMPONENT_ARM_DISARM", 0.0),
            "take_off": ("MAV_CMD_NAV_TAKEOFF", NAN, NAN, NAN, NAN, NAN, NAN, altitude),
            "land": ("MAV_CMD_NAV_LAND", NAN, NAN, NAN, NAN, NAN, NAN, NAN),
            "hover": ("MAV_CMD_DO_SET_MODE", 1.0, AUTO, LOITER),
        }
        if what != "follow":
            if what not in orders:
                raise RefusedError(f"{what!r} is no order. Valid: {', '.join([*orders, 'follow'])}.")
            self.command(*orders[what])
        self._held = what == "hover" or (self._held and what != "follow")

    def command(self, name: str, *numbers: float) -> None:
        """Send a MAV_CMD by name with up to seven numbers, and wait for its acknowledgement.

        Raises:
            RefusedError: it is not accepted. LinkError: no answer.
        """
        common = dialect()
        self._reader.text = ""
        answer = self._answered(name, numbers)
        if answer.result != common.MAV_RESULT_ACCEPTED:
            result = common.enums["MAV_RESULT"][answer.result].name
            raise RefusedError(f"The autopilot answers {name} with {result}. {self._reader.text}".rstrip())

    def _answered(self, name: str, numbers: Sequence[float]) -> Any:
        """Return the acknowledgement of a command, which is sent again while none comes: datagrams get lost."""
        number, until_s = getattr(dialect(), name), time.monotonic() + self._wire.patience_s
        answer, times = None, 0
        while answer is None:
            self._wire.send(command_message(name, *numbers, confirmation=times))
            times += 1
            with suppress(NoAnswerError):
                *before, answer = self._wire.wait_for(
                    "COMMAND_ACK", lambda ack: ack.command == number, within_s=self._asks_again_s
                )
                for message in before:
                    self._reader.take(message)
            if answer is None and time.monotonic() > until_s:
                raise LinkError(f"The autopilot has not answered {name}, sent {times} times.")
        return answer

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
        """Fly to a position (3,) m, with a heading in rad (None: as it is), until it is there and slow.

        Raises:
            RefusedError: the position is out of bounds. LinkError: it does not arrive in time.
        """
        target, yaw = np.asarray(pos, float), self.state.heading if heading is None else heading
        spec = self._specs["base_joint"]
        if not ((spec.low[:3] <= target) & (target <= spec.high[:3])).all():
            raise RefusedError(f"It flies from {spec.low[:3].tolist()} to {spec.high[:3].tolist()} m, not to {target}.")
        action = self._action([*target, math.remainder(yaw, 2.0 * math.pi)], self._joints)

        def there(state: VehicleState) -> bool:
            turned = abs(math.remainder(state.heading - yaw, 2.0 * math.pi)) < WITHIN_RAD
            near, slow = np.linalg.norm(state.pos - target) < WITHIN_M, np.linalg.norm(state.vel) < SLOW_M_S
            return bool(turned and near and slow)

        what = f"go to {target.round(2).tolist()}"
        self._wait(there, what, lambda: self.send("base_joint", action), timeout_s)

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
        target, state = np.asarray(joints, float), self.state
        action = self._action([*state.pos, state.heading], target)

        def there(state: VehicleState) -> bool:
            return bool(np.abs(state.joints - target).max(initial=0.0) < WITHIN_RAD)

        what = f"move the arm to {target.round(2).tolist()}"
        self._wait(there, what, lambda: self.send("base_joint", action), timeout_s)

    def grip(self, opening: float, *, seconds: float = 1.0) -> None:
        """Open the gripper (1), close it (0), or anything between, and let it happen."""
        self._opening = float(opening)
        if opening in (0.0, 1.0):
            action = dialect().GRIPPER_ACTION_RELEASE if opening else dialect().GRIPPER_ACTION_GRAB
            self.command("MAV_CMD_DO_GRIPPER", 1.0, action)
        else:
            self._wire.send(*actuator_messages(self._channels, self._joints, self._opening))
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
                where = self.state.pos.round(2).tolist()
                raise LinkError(f"It did not {what} within {timeout_s:g} s: it is at {where}, {self.state.mode}.")
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
        count, stamp = self._joints.size, self.state.stamp
        if level == "velocity":
            apart = stamp - self._sent_s
            moved = self._joints + (apart if 0.0 < apart < 5.0 * CONTROL_DT_S else CONTROL_DT_S) * arm[:count]
            self._joints = np.clip(moved, self._vehicle.joint_low, self._vehicle.joint_high)
        else:
            self._joints = arm[:count]
        self._sent_s = stamp
        if self._channels.grips:
            self._opening = float(arm[count])

    def _answer(self) -> None:
        """Answer the autopilot's last question for the time: what was sent before is all for this tick."""
        question, self._reader.question = self._reader.question, None
        if question is not None:
            self._wire.send(dialect().MAVLink_timesync_message(question.ts1, question.ts1))
        if self._steps % BEAT_EVERY == 0 and self._wire.heard:
            common = dialect()
            kind = common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID
            self._wire.send(common.MAVLink_heartbeat_message(*kind, 0, 0, common.MAV_STATE_ACTIVE, 3))
        self._steps += 1

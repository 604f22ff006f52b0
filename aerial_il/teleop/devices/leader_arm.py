"""A leader arm: a small arm of serial servos that is moved by hand, and whose joints another arm's take one to one.

As in ALOHA (Zhao et al. 2023, arXiv:2304.13705) joints are mirrored, not the tool; here those of the vehicle's arm,
while its base is flown by another device. Arms of SO-100 and SO-101 (Feetech STS3215) and of Dynamixel's X series are
read; nothing is ever written to a servo, whose torque is off. The calibration is the file that LeRobot's
``lerobot-calibrate`` writes: servo -> number, drive mode, homing offset, and the range of its steps, whose middle is
the joint's zero. A servo keeps its homing offset itself (Present_Position = Actual_Position - Homing_Offset); one that
differs from the file belongs to another calibration, and is refused.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop.input.frame import LEADER_AXES
from aerial_il.teleop.input.hardware import DeviceError, DeviceLostError, Reading, paced
from aerial_il.teleop.input.serial_port import SerialPort
from aerial_il.teleop.input.servo_bus import LANGUAGES, TURN, DamagedError, Register

LIVE = "arm:live"
CONTROLS = (LIVE,)
PERIOD_S, ANSWER_S = 0.01, 0.02  # between two readings, and at most until all servos have answered
STALE_S, SILENT_S = 0.15, 1.0  # a servo without an answer for so long stops the arm; all of them: the arm is gone
GREETINGS = 50  # times that they are asked at first
JUMP_STEPS = 400  # 35 degrees from one reading to the next: believed only when it is said twice
MOST_JOINTS = len(LEADER_AXES) - 1


@dataclass(frozen=True, kw_only=True)
class Servo:
    """One servo's calibration, as LeRobot writes it.

    Attributes:
        id: its number on the line. drive_mode: 1 if it counts the other way. homing_offset: steps that it subtracts
            itself. range_min, range_max: steps at the ends of the joint.
    """

    id: int
    drive_mode: int = 0
    homing_offset: int = 0
    range_min: int = 0
    range_max: int = TURN - 1

    def __post_init__(self) -> None:
        if not 0 <= self.id < 0xFE or self.range_max <= self.range_min or self.drive_mode not in (0, 1):
            raise InvalidValueError(f"No servo is calibrated like this: {self}.")

    def angle(self, steps: int) -> float:
        """Return the joint's angle in rad: zero in the middle of its range."""
        angle = (steps - (self.range_min + self.range_max) / 2) * math.tau / TURN
        return -angle if self.drive_mode else angle

    def opening(self, steps: int) -> float:
        """Return how far a gripper is open, in [0, 1]."""
        share = (steps - self.range_min) / (self.range_max - self.range_min)
        return min(1.0, max(0.0, 1.0 - share if self.drive_mode else share))


def read_calibration(path: str) -> dict[str, Servo]:
    """Return servo name -> calibration, of a file by LeRobot.

    Raises:
        DeviceError: there is no such file. InvalidValueError: it is none.
    """
    try:
        raw = json.loads(Path(path).expanduser().read_text(encoding="utf-8"))
        return {name: Servo(**values) for name, values in raw.items()}
    except OSError as error:
        raise DeviceError(f"leader_arm: the calibration {path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise InvalidValueError(f"leader_arm: {path} is no calibration: {error}") from error


class OpenArm:
    """An arm whose servos answer.

    Args:
        arm: how it is read. line: an open serial line.
    """

    def __init__(self, arm: LeaderArm, line: SerialPort) -> None:
        self._arm, self._line, self._language = arm, line, LANGUAGES[arm.protocol]
        self._servos = arm.servos()
        self._names = {servo.id: name for name, servo in self._servos.items()}
        self._waiting = bytearray()
        self.steps: dict[str, int] = {}
        self._odd: dict[str, int] = {}
        self._heard = dict.fromkeys(self._servos, time.perf_counter())
        self.damaged = 0

    def greet(self) -> None:
        """Make sure that all servos are there, with the homing offsets of the calibration.

        Raises:
            DeviceError: names those that are not.
        """
        values: dict[str, int] = {}
        for _ in range(GREETINGS):
            values |= self._asked(self._language.homing)
            if len(values) == len(self._servos):
                break
        if missing := [f"{name} ({servo.id})" for name, servo in self._servos.items() if name not in values]:
            raise DeviceError(
                f"leader_arm: at {self._arm.port} no answer from {', '.join(missing)}. Is the arm powered, and is "
                f"protocol={self._arm.protocol}, baud={self._arm.baud} right?"
            )
        for name, servo in self._servos.items():
            if values[name] != servo.homing_offset:
                raise DeviceError(
                    f"leader_arm: {name} has the homing offset {values[name]}, its calibration {servo.homing_offset}: "
                    "it belongs to another arm. Calibrate again with lerobot-calibrate."
                )

    def read(self) -> Reading:
        started = time.perf_counter()
        for name, steps in self._asked(self._language.position).items():
            self._believe(name, steps, started)
        if started - max(self._heard.values()) > SILENT_S:
            raise DeviceLostError("no servo answers")
        live = len(self.steps) == len(self._servos) and started - min(self._heard.values()) < STALE_S
        paced(started, PERIOD_S)
        return Reading(self._axes(), (LIVE,)) if live else Reading()

    def close(self) -> None:
        self._line.close()

    def _believe(self, name: str, steps: int, now: float) -> None:
        """Take note of a position; one far from the last only when it is said twice."""
        last, odd = self.steps.get(name), self._odd.pop(name, None)
        if last is not None and abs(steps - last) > JUMP_STEPS and (odd is None or abs(steps - odd) > JUMP_STEPS):
            self._odd[name] = steps
            return
        self.steps[name], self._heard[name] = steps, now

    def _axes(self) -> dict[str, float]:
        axes = {}
        for axis, joint in zip(LEADER_AXES, self._arm.joints, strict=False):
            name = joint.removeprefix("-")
            angle = self._servos[name].angle(self.steps[name]) / math.pi
            axes[axis] = max(-1.0, min(1.0, -angle if joint.startswith("-") else angle))
        if self._arm.gripper is not None:
            axes[LEADER_AXES[-1]] = self._servos[self._arm.gripper].opening(self.steps[self._arm.gripper])
        return axes

    def _asked(self, register: Register) -> dict[str, int]:
        """Return servo -> value of a register, of those that answer in time."""
        self._waiting.clear()
        self._line.write(self._language.sync_read(register, [servo.id for servo in self._servos.values()]))
        values: dict[str, int] = {}
        until = time.perf_counter() + ANSWER_S
        while len(values) < len(self._servos) and (left := until - time.perf_counter()) > 0.0:
            self._waiting += self._line.read(left)
            values |= self._taken(register)
        return values

    def _taken(self, register: Register) -> dict[str, int]:
        values: dict[str, int] = {}
        while True:
            try:
                answer = self._language.take(self._waiting)
            except DamagedError:
                self.damaged += 1
                continue
            if answer is None:
                return values
            if answer.servo in self._names and len(answer.data) == register.size:
                values[self._names[answer.servo]] = register.value(answer.data)


@dataclass(frozen=True)
class LeaderArm:
    """How a leader arm is read.

    Attributes:
        port: its serial line, e.g. ``/dev/ttyACM0``. calibration: the file of LeRobot's.
        joints: which servo each joint of the vehicle's arm follows, from the base on; ``-`` for the other way.
        gripper: the servo of its trigger; None for none. protocol: ``feetech`` or ``dynamixel``. baud: bits per second.
    """

    port: str | None = None
    calibration: str | None = None
    joints: Sequence[str] = ()
    gripper: str | None = None
    protocol: str = "feetech"
    baud: int = 1_000_000

    def __post_init__(self) -> None:
        if self.protocol not in LANGUAGES:
            raise UnknownNameError("protocol of leader_arm", self.protocol, LANGUAGES)
        if not 1 <= len(self.joints) <= MOST_JOINTS:
            raise InvalidValueError(f"leader_arm has 1 to {MOST_JOINTS} joints, got {list(self.joints)}.")

    def open(self) -> OpenArm:
        """Open its line, and hear whether all servos are there."""
        if self.port is None or self.calibration is None:
            raise DeviceError(
                "leader_arm: say where it is, hardware=[leader_arm.port:/dev/ttyACM0,leader_arm.calibration:FILE]; the "
                "file is the one of lerobot-calibrate."
            )
        self.servos()
        opened = OpenArm(self, SerialPort(self.port, self.baud))
        try:
            opened.greet()
        except BaseException:
            opened.close()
            raise
        return opened

    def servos(self) -> Mapping[str, Servo]:
        """Return the calibration of the servos that are read.

        Raises:
            UnknownNameError: a servo that the calibration does not name.
        """
        known = read_calibration(self.calibration or "")
        names = [joint.removeprefix("-") for joint in self.joints]
        for name in names if self.gripper is None else [*names, self.gripper]:
            if name not in known:
                raise UnknownNameError("servo of leader_arm", name, known)
        return {name: servo for name, servo in known.items() if name in names or name == self.gripper}


DRIVER = LeaderArm

"""What a person commands at one tick, in SI units, and the modes in which sticks mean different things."""

from collections.abc import Mapping
from dataclasses import dataclass

from aerial_il.control.actions import ActionLevel
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.errors import UnknownNameError
from aerial_il.teleop.input.mapping import TURNS

Vec3 = tuple[float, float, float]

TOOL_SPEED, BASE_SPEED = 0.4, 0.6  # m/s
YAW_RATE, TURN_RATE, JOINT_RATE = 0.9, 0.8, 0.8  # rad/s
GRIP_RATE = 2.5  # strokes per second
PRECISION = 0.3
STICKS = ("forward", "lateral", "up", "yaw")
LEVELS = ("ee_pose", "ee_delta", "base_joint", "velocity")


@dataclass(frozen=True)
class Command:
    """Rates for the coming tick; all zero means hover where you are.

    Attributes:
        linear: m/s, along the heading: forward, left, up.
        yaw_rate: rad/s about the vertical, to the left.
        turn: rad/s of the tool about the heading's axes: roll (its left side up), pitch (its point down).
        joints: joint -> rad/s.
        grip: openings per second; positive closes.
        led: joint -> rad, where a leader arm holds it.
        carry: whether a yaw turns the tool about the base, as a rigid body, or on the spot.
    """

    linear: Vec3 = (0.0, 0.0, 0.0)
    yaw_rate: float = 0.0
    turn: tuple[float, float] = (0.0, 0.0)
    joints: tuple[tuple[int, float], ...] = ()
    grip: float = 0.0
    led: tuple[tuple[int, float], ...] = ()
    carry: bool = False


def check_level(level: str) -> None:
    """Refuse an action level that no person can fly.

    Raises:
        UnknownNameError: names those that one can.
    """
    if level not in LEVELS:
        known = [each.label for each in ActionLevel]
        hint = "It asks for thrusts fifty times a second." if level in known else ""
        raise UnknownNameError("action level for teleoperation", level, LEVELS, hint)


def modes_of(level: str, vehicle: Vehicle) -> tuple[str, ...]:
    """Return the modes that a level offers on a vehicle, the default one first.

    Where the tool is commanded: ``tool`` (it moves along the heading), ``base`` (all moves as one body) and ``wrist``
    (it turns on the spot). Where base and joints are: ``base``, and ``joints 1-4`` and so on, one joint a stick axis.
    """
    if level in ("ee_pose", "ee_delta"):
        return ("tool", "base", "wrist") if vehicle.base_mobility else ("tool", "wrist")
    count, size = vehicle.num_joints, len(STICKS)
    groups = tuple(f"joints {i + 1}-{min(i + size, count)}" for i in range(0, count, size))
    return ("base", *groups) if vehicle.base_mobility else groups


def command_of(motions: Mapping[str, float], mode: str, *, precise: bool) -> Command:
    """Return the command that shaped ``motions`` in [-1, 1] mean in a mode."""
    share = PRECISION if precise else 1.0
    forward, lateral, up, yaw = (share * motions[name] for name in STICKS)
    grip = GRIP_RATE * motions["grip"]
    roll, pitch = (share * TURN_RATE * motions[name] for name in TURNS)
    if mode == "tool":
        return Command(_scaled(TOOL_SPEED, forward, lateral, up), YAW_RATE * yaw, (roll, pitch), grip=grip)
    if mode == "base":
        return Command(_scaled(BASE_SPEED, forward, lateral, up), YAW_RATE * yaw, grip=grip, carry=True)
    if mode == "wrist":
        turn = (roll - TURN_RATE * lateral, pitch + TURN_RATE * forward)
        return Command(_scaled(TOOL_SPEED, 0.0, 0.0, up), YAW_RATE * yaw, turn, grip=grip)
    first, last = (int(text) for text in mode.removeprefix("joints ").split("-"))
    rates = (JOINT_RATE * value for value in (forward, lateral, up, yaw))
    return Command(joints=tuple(zip(range(first - 1, last), rates, strict=False)), grip=grip)


def _scaled(speed: float, *parts: float) -> Vec3:
    forward, lateral, up = (speed * part for part in parts)
    return forward, lateral, up

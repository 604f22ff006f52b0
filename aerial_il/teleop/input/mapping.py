"""Which key, button or stick means which command: read from YAML, checked for conflicts, asked once a tick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.teleop.input.frame import AXES, NUM_CONTROLS, DeviceFrame, names_of

KEYED: tuple[str, ...] = ("forward", "lateral", "up", "yaw", "grip")  # signed, in [-1, 1]: keys and sticks give them
TURNS: tuple[str, ...] = ("roll", "pitch")  # given by devices with six axes alone
MOTIONS: tuple[str, ...] = (*KEYED, *TURNS)
POSE = tuple(f"pose_{part}" for part in ("x", "y", "z", "roll", "pitch", "yaw"))  # taken while clutched
JOINTS: tuple[str, ...] = tuple(f"joint_{i}" for i in range(1, 9))  # taken one to one, while led
FOLLOWED = (*POSE, *JOINTS, "joint_grip")  # places, not speeds: one device only may give each
HELD: tuple[str, ...] = ("precision", "take_over", "clutch", "lead")
PRESSED: tuple[str, ...] = (
    "mode", "record", "save", "discard", "undo", "label", "pause", "camera", "numbers", "help", "gust", "push", "drop",
)  # fmt: skip
DIRECTIONS = tuple(f"{motion}{sign}" for motion in KEYED for sign in "+-")
COMMANDS = (*MOTIONS, *DIRECTIONS, *FOLLOWED, *HELD, *PRESSED)
AXIAL = (*MOTIONS, *FOLLOWED)  # commands that take axes


@dataclass(frozen=True)
class Intent:
    """What a person wants at one tick, before it is shaped.

    Attributes:
        analogue: motion -> what sticks and triggers say, in [-1, 1].
        digital: motion -> what keys say: -1, 0 or 1.
        held: commands that are held. pressed: commands that were pressed since the last tick.
        pose: how far a phone was moved since its clutch was closed: m ahead, left and up, and a rotation vector in
            rad; None unless one is clutched. joints: joint -> rad, while led. opening: of the gripper, in [0, 1], while
            led by a device that has one.
    """

    analogue: Mapping[str, float] = field(default_factory=dict)
    digital: Mapping[str, float] = field(default_factory=dict)
    held: frozenset[str] = frozenset()
    pressed: frozenset[str] = frozenset()
    pose: tuple[float, ...] | None = None
    joints: Mapping[int, float] = field(default_factory=dict)
    opening: float | None = None


@dataclass(frozen=True)
class Bindings:
    """The controls of one or several devices and what they mean.

    Attributes:
        keys: control name -> command, in the order of a frame's bits.
        axes: motion -> signed axes, e.g. ``("-right_y",)``.
    """

    keys: Mapping[str, str]
    axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.keys) > NUM_CONTROLS:
            raise InvalidValueError(f"{len(self.keys)} controls are bound; a device frame holds {NUM_CONTROLS}.")

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of the controls in the order of a frame's bits."""
        return tuple(self.keys)

    def intent(self, frame: DeviceFrame) -> Intent:
        """Return what ``frame`` asks for; a control pressed and released between two ticks counts for one tick."""
        down = {self.keys[name] for name in names_of(frame.held | frame.edges, self.controls)}
        pressed = frozenset(self.keys[name] for name in names_of(frame.edges, self.controls))
        led = [name for name in JOINTS if name in self.axes] if "lead" in down else []
        return Intent(
            analogue={motion: self._analogue(frame, motion) for motion in MOTIONS},
            digital={m: float(f"{m}+" in down) - float(f"{m}-" in down) for m in MOTIONS},
            held=frozenset(down & set(HELD)),
            pressed=pressed & {*PRESSED, "clutch"},
            pose=self._pose(frame) if "clutch" in down else None,
            joints={JOINTS.index(name): math.pi * self._analogue(frame, name) for name in led},
            opening=self._analogue(frame, "joint_grip") if "lead" in down and "joint_grip" in self.axes else None,
        )

    def _pose(self, frame: DeviceFrame) -> tuple[float, ...]:
        moved = [self._analogue(frame, name) for name in POSE]
        return (*moved[:3], *(math.pi * angle for angle in moved[3:]))

    def _analogue(self, frame: DeviceFrame, motion: str) -> float:
        signed = (_signed(name) for name in self.axes.get(motion, ()))
        return sum(sign * frame.axes[AXES.index(axis)] for sign, axis in signed)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as recordings carry them: in lists, for the order of the keys is that of the bits."""
        return {
            "keys": [list(pair) for pair in self.keys.items()],
            "axes": {motion: list(axes) for motion, axes in self.axes.items()},
        }

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> Bindings:
        """Return the bindings of a recording."""
        return Bindings(dict(raw["keys"]), {motion: tuple(axes) for motion, axes in raw["axes"].items()})

    def keys_of(self, command: str) -> tuple[str, ...]:
        """Return the controls that give ``command``."""
        return tuple(name for name, bound in self.keys.items() if bound == command)


def read_bindings(raw: Mapping[str, Any], controls: Sequence[str], *, device: str) -> Bindings:
    """Check the mapping of one device.

    Args:
        raw: command -> control or list of controls; motions without a sign take axes, with ``-`` for the other way.
        controls: names that the device's controls have. device: its name, for errors.

    Raises:
        UnknownNameError: a command, control or axis that there is not. InvalidValueError: a control bound twice.
    """
    keys: dict[str, str] = {}
    axes: dict[str, tuple[str, ...]] = {}
    for command, bound in raw.items():
        if command not in COMMANDS:
            raise UnknownNameError(f"command in the mapping of {device}", command, COMMANDS)
        names = [bound] if isinstance(bound, str) else list(bound or [])
        if command in AXIAL:
            axes[command] = tuple(_checked_axis(name, device) for name in names)
            continue
        for name in names:
            if name not in controls:
                raise UnknownNameError(f"control of {device}", name, controls)
            if name in keys:
                raise InvalidValueError(
                    f"{device}: {name} is bound twice, to {keys[name]!r} and to {command!r}. Take another key for one."
                )
            keys[name] = command
    return Bindings(keys, axes)


def together(all_bindings: Iterable[Bindings]) -> Bindings:
    """Return the bindings of several devices used at once; their controls have names of their own."""
    keys: dict[str, str] = {}
    axes: dict[str, tuple[str, ...]] = {}
    for bindings in all_bindings:
        if shared := keys.keys() & bindings.keys.keys():
            raise InvalidValueError(f"Two devices have a control {min(shared)!r}; name each device once.")
        if both := bindings.axes.keys() & axes.keys() & set(FOLLOWED):
            raise InvalidValueError(
                f"Two devices give {min(both)!r}, of which there can be one. Leave one of them out of devices=[...]."
            )
        keys |= bindings.keys
        axes |= {m: tuple(dict.fromkeys((*axes.get(m, ()), *names))) for m, names in bindings.axes.items()}
    return Bindings(keys, axes)


def _checked_axis(name: str, device: str) -> str:
    if _signed(name)[1] not in AXES:
        raise UnknownNameError(f"axis of {device}", name, AXES)
    return name


def _signed(name: str) -> tuple[float, str]:
    return (-1.0, name[1:]) if name.startswith("-") else (1.0, name)

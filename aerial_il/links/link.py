"""What a robot is to whoever flies it over a link: it shows its state, follows set points and obeys a few orders.

A set point is an action at one of the levels of :mod:`aerial_il.control.actions`; it holds until the next one, and a
robot that hears none for a while hovers by itself. Levels may change from one set point to the next.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.specs import EnvSpec

LINKED_LEVELS = ("ee_pose", "base_joint", "velocity")  # a lost set point of these changes nothing that comes later
QUIET_S = 0.2  # without a set point for longer, a robot hovers


class Mode(StrEnum):
    """What a robot is about."""

    STANDING = "standing"  # in its cradle, or on its skids
    TAKING_OFF = "taking_off"
    FLYING = "flying"  # follows set points
    HOLDING = "holding"  # hovers: it was told to, or hears nothing
    LANDING = "landing"
    CRASHED = "crashed"


class Order(StrEnum):
    """What a robot is told besides set points."""

    ARM = "arm"
    TAKE_OFF = "take_off"  # height_m above where it stands; 0: fly from there
    HOVER = "hover"  # until FOLLOW: set points do not count meanwhile
    FOLLOW = "follow"  # set points again
    LAND = "land"  # where it took off
    DISARM = "disarm"
    RESET = "reset"  # seed: of the episode that a simulated robot begins


class RefusedError(AerialError):
    """A robot refuses an order or a set point, and says why; it goes on as it did."""


class LinkError(AerialError):
    """A link cannot be opened, or is gone."""


@dataclass(frozen=True)
class Reading:
    """What a robot showed at one moment.

    Attributes:
        obs: name -> (*shape,), the fields of the link's specification. stamp_s: when, by the robot's clock.
        mode: see :class:`Mode`. armed: whether its rotors may turn.
        told: what a simulator knows besides: ``success``, ``crash``, ``dropped``, ``state``, ``ctrl``, ….
    """

    obs: Mapping[str, np.ndarray]
    stamp_s: float
    mode: Mode
    armed: bool
    told: Mapping[str, Any] = field(default_factory=dict)


class Link(Protocol):
    """A robot, near or far. Numbers are in SI units, positions in the world's frame, z up."""

    @property
    def spec(self) -> EnvSpec:
        """Fields of its readings, and the actions of the level that was asked for."""
        ...

    @property
    def lockstep(self) -> bool:
        """Whether the robot's time stands still until :meth:`step`."""
        ...

    def read(self) -> Reading | None:
        """Return the newest reading that has arrived, without waiting; None before the first."""
        ...

    def send(self, level: str, action: np.ndarray) -> None:
        """Let the robot follow a set point (Da,) from now on.

        Raises:
            RefusedError: it is not finite, has another size, or the robot does not take the level.
        """
        ...

    def order(self, order: Order, **numbers: float) -> None:
        """Give an order, and return when it was taken.

        Raises:
            RefusedError: the robot refuses it, and says why. LinkError: it does not answer.
        """
        ...

    def step(self) -> None:
        """Let 20 ms pass, in lockstep."""
        ...

    def close(self) -> None:
        """Give up the link; a robot in the air hovers."""
        ...


def require_linked(level: str) -> None:
    """Refuse a level whose set points do not stand for themselves.

    Raises:
        InvalidValueError: names those that do.
    """
    if level not in LINKED_LEVELS:
        raise InvalidValueError(
            f"action={level} is not flown over a link: a set point that is lost or late would change all that follow. "
            f"Valid: {', '.join(LINKED_LEVELS)}."
        )

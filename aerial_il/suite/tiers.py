"""Disturbance tiers: what an episode is disturbed by, as names that can be taken apart and put together.

A tier is written ``NAME`` or ``NAME+COMPONENT-COMPONENT…``: ``gusts``, ``calm+latency``, ``hard-payload``. A component
that is added has the strength it has in ``hard``. Strengths are relative to the vehicle or the object they act on, so
that one tier fits all. ``docs/tiers.md`` explains every number.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite.physics.episode_state import MAX_LAG
from aerial_il.suite.physics.sensing import Sensors


@dataclass(frozen=True)
class Wind:
    """Mean wind with Dryden turbulence.

    See :mod:`aerial_il.suite.physics.wind`.

    Attributes:
        share: by how much of the vehicle's weight the largest gust changes its drag.
    """

    share: float


@dataclass(frozen=True)
class Payload:
    """Masses that the controller does not know.

    Attributes:
        object_mass: half width of the range of an object's mass, as a share of the nominal one.
        base_mass: largest additional mass somewhere in the hub, as a share of the vehicle's.
    """

    object_mass: float = 0.3
    base_mass: float = 0.05


@dataclass(frozen=True)
class Friction:
    """Friction that is not the nominal one.

    Attributes:
        contact: half width of the range of all contacts' sliding friction, as a share of the nominal one.
        joint: the same for the dry friction of hinges and slides of fixtures.
    """

    contact: float = 0.3
    joint: float = 0.3


@dataclass(frozen=True)
class Latency:
    """Actions that arrive late by a whole number of control steps of 20 ms, the same for a whole episode.

    Attributes:
        least, most: control steps.
    """

    least: int = 1
    most: int = 2


@dataclass(frozen=True)
class Noise:
    """Errors of the state that the flight controller measures.

    Attributes:
        scale: multiple of the standard deviations of :class:`aerial_il.suite.physics.sensing.Sensors`.
    """

    scale: float = 1.0


@dataclass(frozen=True)
class Estimation:
    """Errors of what a policy is shown, in the place of the truth.

    The robot's own pose is shown as the flight controller estimates it, with the errors of :class:`Noise`. Objects are
    seen: each has a pose error of its own, which moves all of it as one, and is seen late. Biases stay the same for an
    episode, noise is Gauss–Markov; all are standard deviations along or about each axis. ``docs/tiers.md`` has the
    sources.

    Attributes:
        frame_bias: m, between the frame of the robot's estimate and that in which objects are seen; common to all.
        position_bias, position_noise: m. angle_bias, angle_noise: rad.
        time: correlation time of the noise, s.
        lag: control steps of 20 ms by which objects are seen late.
        force_bias, force_noise: N, of force sensors; this noise is independent from one control step to the next.

    Raises:
        InvalidValueError: a negative number, or more lag than the episode's memory holds.
    """

    frame_bias: float = 0.002
    position_bias: float = 0.002
    position_noise: float = 0.001
    angle_bias: float = 0.01
    angle_noise: float = 0.005
    time: float = 0.1
    lag: int = 3
    force_bias: float = 0.1
    force_noise: float = 0.1

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value < 0 or (name == "time" and value == 0):
                raise InvalidValueError(f"Estimation's {name} is {value}; it must not be negative, nor time zero.")
        if self.lag > MAX_LAG:
            raise InvalidValueError(f"Estimation's lag is {self.lag} control steps; at most {MAX_LAG} are remembered.")


@dataclass(frozen=True)
class Motors:
    """Rotors that push more or less than commanded.

    Attributes:
        gain: half width of the range of each rotor's thrust, as a share of the commanded one.
    """

    gain: float = 0.05


@dataclass(frozen=True)
class Tier:
    """Disturbances of an episode by component; None for a component that is absent.

    Attributes:
        name: canonical name; equal tiers that are put together differently have equal names.
    """

    name: str
    wind: Wind | None = None
    payload: Payload | None = None
    friction: Friction | None = None
    latency: Latency | None = None
    noise: Noise | None = None
    motors: Motors | None = None
    estimation: Estimation | None = None

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components that are present."""
        return tuple(name for name in COMPONENTS if getattr(self, name) is not None)

    @property
    def sensors(self) -> Sensors:
        """Errors of the state estimate."""
        scale, nominal = self.noise.scale if self.noise else 0.0, Sensors()
        errors = (scale * error for error in nominal[:-1])
        return Sensors(*errors, time=nominal.time)

    def to_dict(self) -> dict[str, Any]:
        """The components with their strengths as plain values."""
        return {name: asdict(getattr(self, name)) for name in self.components}


COMPONENTS = ("wind", "payload", "friction", "latency", "noise", "motors", "estimation")
ROUGH_SIGHT = Estimation(  # half as much again as in gusts
    frame_bias=0.003,
    position_bias=0.003,
    position_noise=0.0015,
    angle_bias=0.015,
    angle_noise=0.0075,
    lag=4,
    force_bias=0.15,
    force_noise=0.15,
)
HARD = Tier(
    "hard",
    wind=Wind(0.13),
    payload=Payload(),
    friction=Friction(),
    latency=Latency(),
    noise=Noise(1.5),
    motors=Motors(),
    estimation=ROUGH_SIGHT,
)
_TIERS = {
    tier.name: tier
    for tier in (
        Tier("calm", noise=Noise()),
        Tier("breeze", wind=Wind(0.06), noise=Noise()),
        Tier("gusts", wind=HARD.wind, noise=Noise(), estimation=Estimation()),
        HARD,
    )
}
_TERM = re.compile(r"([+-])([^+-]*)")


def names() -> tuple[str, ...]:
    """Names of all tiers, from calm to rough."""
    return tuple(_TIERS)


@cache
def get(name: str) -> Tier:
    """Return the tier that ``name`` describes.

    Raises:
        UnknownNameError: no tier or no component has that name.
        InvalidValueError: a component is added that is there, or removed that is not.
    """
    base, changes = re.split(r"[+-]", name, maxsplit=1)[0], _TERM.findall(name)
    if base not in _TIERS:
        raise UnknownNameError("tier", base, names(), f"Components may be added or removed: {_example()}.")
    tier = _TIERS[base]
    for sign, component in changes:
        tier = _changed(tier, sign, component)
    return replace(tier, name=_canonical(tier, _TIERS[base]))


def _changed(tier: Tier, sign: str, component: str) -> Tier:
    if component not in COMPONENTS:
        raise UnknownNameError("tier component", component, COMPONENTS, f"For example: {_example()}.")
    wanted = getattr(HARD, component) if sign == "+" else None
    if getattr(tier, component) == wanted:
        state = "has" if wanted else "has no"
        raise InvalidValueError(
            f"Tier {tier.name!r} {state} {component} anyway; its components: {', '.join(tier.components) or 'none'}."
        )
    return replace(tier, **{component: wanted})


def _canonical(tier: Tier, base: Tier) -> str:
    """Name of a tier: that of its base, then what was added, then what was removed, each in the order of COMPONENTS."""
    changed = [name for name in COMPONENTS if getattr(tier, name) != getattr(base, name)]
    added = [f"+{name}" for name in changed if getattr(tier, name) is not None]
    removed = [f"-{name}" for name in changed if getattr(tier, name) is None]
    return "".join([base.name, *added, *removed])


def _example() -> str:
    return f"gusts+latency, hard-payload ({', '.join(COMPONENTS)})"

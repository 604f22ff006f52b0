"""Disturbance tiers: how rough the air is. Strengths are relative to weight, so that one tier fits all vehicles."""

from __future__ import annotations

from dataclasses import dataclass, field

from aerial_il.core.errors import UnknownNameError
from aerial_il.suite.sensing import Sensors


@dataclass(frozen=True)
class Tier:
    """Gusts on the base, as a stationary random process, and errors of the state estimate.

    Attributes:
        name: registry name.
        gust_force: standard deviation of the force along each axis, as a share of weight.
        gust_limit: largest force along each axis, as a share of weight.
        gust_time_s: correlation time of the wind at the vehicle.
        gust_arm_m: lever that turns the force's strength into that of the torque.
        sensors: errors of the state that the flight controller measures.
    """

    name: str
    gust_force: float = 0.0
    gust_limit: float = 0.0
    gust_time_s: float = 1.0
    gust_arm_m: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)


_TIERS = {
    tier.name: tier
    for tier in (
        Tier("calm"),
        Tier("gusts", gust_force=0.065, gust_limit=0.13, gust_time_s=1.0, gust_arm_m=0.02),
    )
}


def names() -> tuple[str, ...]:
    """Names of all tiers, from calm to rough."""
    return tuple(_TIERS)


def get(name: str) -> Tier:
    """Return the tier called ``name``.

    Raises:
        UnknownNameError: no tier has that name.
    """
    if name not in _TIERS:
        raise UnknownNameError("tier", name, names())
    return _TIERS[name]

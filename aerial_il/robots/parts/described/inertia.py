"""Mass and inertia of rigid bodies: whether they can be those of a solid, and their sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

ROUNDING = 1e-6  # of the largest moment: what figures written with six digits are off by


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Mass (kg), centre of mass (3,) m, and inertia tensor (3, 3) about it, kg m², all along the axes of one frame."""

    mass: float
    com: np.ndarray
    tensor: np.ndarray


def flaw(mass: float, tensor: np.ndarray) -> str:
    """Say why no solid has this mass and inertia, in a clause; an empty string if one has.

    The moments about the principal axes are sums of two of three positive integrals (of x², y² and z²), so that none
    exceeds the sum of the others (Goldstein, Classical Mechanics, 3rd ed. 2002, ch. 5).
    """
    if not np.isfinite(mass) or mass <= 0.0:
        return f"its mass is {mass:g} kg, and must be above zero"
    if not np.isfinite(tensor).all():
        return "a moment of inertia is not a finite number"
    small, middle, large = (float(moment) for moment in np.linalg.eigvalsh(tensor))
    shown = f"{small:.4g}, {middle:.4g} and {large:.4g} kg m²"
    if small <= 0.0:
        return f"its principal moments of inertia are {shown}: all must be above zero"
    if small + middle < large * (1.0 - ROUNDING):
        return f"its principal moments of inertia are {shown}: the largest exceeds the sum of the others, in no solid"
    return ""


def joined(bodies: Sequence[RigidBody]) -> RigidBody:
    """Return bodies that are welded to each other as one."""
    mass = sum(body.mass for body in bodies)
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
    tensor = sum((body.tensor + body.mass * about(body.com - com) for body in bodies), np.zeros((3, 3)))
    return RigidBody(mass, com, tensor)


def about(lever: np.ndarray) -> np.ndarray:
    """Inertia tensor (3, 3) per kilogram of a point at ``lever`` (3,) m."""
    return float(lever @ lever) * np.eye(3) - np.outer(lever, lever)

"""Figures of a joint as a model file gives them, whichever format it is in."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class JointFigures:
    """One joint that turns.

    Attributes:
        limits: rad, None where it turns without end.
        torque: N m, speed: rad/s, None where the file does not say.
        stiffness, damping: gains of its servo, N m/rad and N m s/rad; armature: kg m²; None where it does not say.
        coupled: what else of the file moves it, or an empty string.
    """

    limits: tuple[float, float] | None
    torque: float | None = None
    speed: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    armature: float | None = None
    coupled: str = ""

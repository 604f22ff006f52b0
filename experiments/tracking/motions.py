"""References that a tool can be asked to follow: poses to hold and closed curves flown at constant speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

CURVE_POINTS = 2000
CIRCLE_RADIUS_M = 0.3
EIGHT_HALF_WIDTH_M, EIGHT_HALF_HEIGHT_M = 0.3, 0.15

Kind = Literal["hover", "moving"]


@dataclass(frozen=True, eq=False)
class Motion:
    """A tool position over time with a fixed orientation.

    Attributes:
        name: for tables. curve: (K, 3) points in the world, m; one point to hold, or a closed curve.
        pitch_rad: downward pitch of the tool, a quarter turn points straight down. yaw_rad: its heading.
    """

    name: str
    curve: np.ndarray
    pitch_rad: float
    yaw_rad: float = 0.0

    @property
    def kind(self) -> Kind:
        return "hover" if len(self.curve) == 1 else "moving"

    @property
    def rot6d(self) -> np.ndarray:
        """(6,) first two columns of the tool's rotation, world from tool: yaw, then pitch."""
        c, s, cp, sp = np.cos(self.yaw_rad), np.sin(self.yaw_rad), np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        return np.array([c * cp, s * cp, -sp, -s, c, 0.0])

    def positions(self, times_s: np.ndarray, speed_m_s: float) -> np.ndarray:
        """Return where the tool should be at ``times_s`` (T,), as (T, 3), after starting at the curve's first point."""
        if self.kind == "hover":
            return np.broadcast_to(self.curve, (len(times_s), 3))
        closed = np.concatenate([self.curve, self.curve[:1]])
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
        along = np.mod(speed_m_s * times_s, length[-1])
        return np.stack([np.interp(along, length, closed[:, axis]) for axis in range(3)], axis=1)


def poses() -> tuple[Motion, ...]:
    """Poses to hover in: straight down, obliquely and nearly level, in the middle and towards the corners."""
    return (
        _pose("down, centre", (0.0, 0.0, 1.0), 90.0, 0.0),
        _pose("oblique, forward", (0.3, 0.0, 1.0), 45.0, 0.0),
        _pose("level, high left", (0.4, 0.4, 1.2), 30.0, 35.0),
        _pose("steep, low right", (-0.3, -0.4, 0.7), 75.0, -35.0),
    )


def curves() -> tuple[Motion, ...]:
    """A horizontal circle, tool down, and a figure eight in a vertical plane across x and y, tool oblique."""
    angle = np.linspace(0.0, 2.0 * np.pi, CURVE_POINTS, endpoint=False)
    circle = CIRCLE_RADIUS_M * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    sideways = EIGHT_HALF_WIDTH_M * np.sin(angle) / np.sqrt(2.0)
    eight = np.stack([sideways, sideways, EIGHT_HALF_HEIGHT_M * np.sin(2.0 * angle)], axis=1)
    middle = np.array([0.0, 0.0, 1.0])
    return (
        Motion("circle, horizontal", middle + circle, np.deg2rad(90.0)),
        Motion("eight, vertical", middle + eight, np.deg2rad(45.0)),
    )


def _pose(name: str, pos: tuple[float, float, float], pitch_deg: float, yaw_deg: float) -> Motion:
    return Motion(name, np.array([pos]), np.deg2rad(pitch_deg), np.deg2rad(yaw_deg))

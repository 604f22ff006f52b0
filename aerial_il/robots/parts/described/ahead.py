"""The zero of an arm's joints: the pose in which its tool points ahead."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from aerial_il.robots.parts.described.chain import Chain
from aerial_il.robots.parts.described.placement import Placement, turned_about

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
AHEAD = np.array([1.0, 0.0, 0.0])
ALIGNED_RAD = 1e-3
STEPS, STEP_RAD, DAMPING = 200, 0.3, 1e-4
STARTS_RAD = (0.0, 0.1, -0.1)


def require_ahead(place: Placement, chain: Chain, approach: Axis, zero: tuple[float, ...]) -> None:
    """Require that the tool points along the vehicle's x axis, in the posture of ``place``.

    Raises:
        ModelFileError: it does not; the message gives joint values of the file at which it would.
    """
    if approach not in get_args(Axis):
        raise place.model.error(f"approach={approach!r} is not one of {', '.join(get_args(Axis))}.")
    column = place.axes(place.data.xmat[chain.tool])[:, "xyz".index(approach[-1])]
    out = -column if approach.startswith("-") else column
    angle = float(np.arccos(np.clip(out @ AHEAD, -1.0, 1.0)))
    if angle <= ALIGNED_RAD:
        return
    turn, left = _turn_ahead(np.array([place.direction(place.data.xaxis[joint]) for joint in chain.joints]), out)
    advice = f"zero=({', '.join(f'{round(a + b, 4) + 0.0:g}' for a, b in zip(zero, turn, strict=True))},)"
    if left > ALIGNED_RAD:
        advice = "its joints cannot turn it there, so that the arm must be mounted in another way (mount_rpy=...)"
    shown = ", ".join(f"{value:.2f}" for value in out)
    raise place.model.error(
        f"where its joints count as zero, {approach} of the tool {place.model.name(chain.tool)!r}, taken for the "
        f"axis out of the gripper, points along ({shown}) of the vehicle, {np.rad2deg(angle):.3g}° from (1, 0, 0). "
        f"Say another axis (approach=...), or where to count from: {advice}.",
    )


def _turn_ahead(axes: np.ndarray, out: np.ndarray) -> tuple[np.ndarray, float]:
    """Joint turns (J,) that bring a direction of the last link to (1, 0, 0), and the angle that is left, rad.

    Tried from several turns: from none, a tool that points backwards would not know which way round.
    """
    tried = (_turned_from(start * np.ones(len(axes)), axes, out) for start in STARTS_RAD)
    return min(tried, key=lambda found: found[1] > ALIGNED_RAD)


def _turned_from(turn: np.ndarray, axes: np.ndarray, out: np.ndarray) -> tuple[np.ndarray, float]:
    """Joint turns, and the angle that is left, from a first guess of the turns (J,).

    Damped Gauss-Newton steps (Wampler, IEEE SMC 1986); ``axes`` (J, 3) and ``out`` (3,) are those without turns.
    """
    now = out
    for _ in range(STEPS):
        now, columns = out, []
        for angle, axis in zip(turn[::-1], axes[::-1], strict=True):
            now = turned_about(axis, angle) @ now
            columns = [np.cross(axis, now), *(turned_about(axis, angle) @ column for column in columns)]
        jacobian = np.array(columns).T
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(3), AHEAD - now)
        turn = turn + np.clip(step, -STEP_RAD, STEP_RAD)
    return (turn + np.pi) % (2.0 * np.pi) - np.pi, float(np.arccos(np.clip(now @ AHEAD, -1.0, 1.0)))

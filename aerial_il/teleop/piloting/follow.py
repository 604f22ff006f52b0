"""A pose that is followed while a clutch is closed: how far a hand has moved becomes speeds, without a jump."""

import math
from collections.abc import Sequence
from dataclasses import replace

from aerial_il.core.rotations import (
    IDENTITY,
    add,
    limit_norm,
    mat_from_rotvec,
    mat_from_yaw,
    matmul,
    matmul_back,
    rotate,
    rotate_back,
    rotvec_from_mat,
    scale,
    sub,
)
from aerial_il.teleop.piloting.command import TOOL_SPEED, TURN_RATE, Command, Vec3

AHEAD = 2  # ticks in which what is left is made up for, so that the last bit does not ring


class Follower:
    """Turns the pose of a hand since its clutch was closed into speeds that catch up with it.

    What the hand did before the clutch was closed, or while it was open, moves nothing; what it did too fast is made up
    for at the largest speed, until the clutch is opened.
    """

    def __init__(self) -> None:
        self.let_go()

    def let_go(self) -> None:
        """Forget what was to be followed: the clutch is open."""
        self._heading: float | None = None
        self._pos: Vec3 = (0.0, 0.0, 0.0)
        self._rot = IDENTITY

    def step(self, pose: Sequence[float], heading: float, dt: float, *, closed_now: bool) -> Command:
        """Return the speeds of the coming tick.

        Args:
            pose: m ahead, left, up since the clutch was closed, and a rotation vector in rad. heading: of the vehicle,
                rad. dt: s of a tick. closed_now: whether the clutch was closed in this tick.
        """
        place, turned = (pose[0], pose[1], pose[2]), mat_from_rotvec((pose[3], pose[4], pose[5]))
        if self._heading is None or closed_now:
            self._heading, self._pos, self._rot = heading, place, turned
        linear = limit_norm(scale(1.0 / (AHEAD * dt), sub(place, self._pos)), TOOL_SPEED)
        left = rotate(self._rot, rotvec_from_mat(matmul_back(self._rot, turned)))
        spin = limit_norm(scale(1.0 / (AHEAD * dt), left), TURN_RATE)
        self._pos = add(self._pos, scale(dt, linear))
        self._rot = matmul(mat_from_rotvec(scale(dt, spin)), self._rot)
        since = mat_from_yaw(math.remainder(heading - self._heading, math.tau))
        ahead, axis = rotate_back(since, linear), rotate_back(since, spin)
        return Command(ahead, axis[2], (axis[0], axis[1]))


def together(command: Command, followed: Command) -> Command:
    """Return ``command`` of sticks with the speeds of a followed pose on top."""
    turn = command.turn[0] + followed.turn[0], command.turn[1] + followed.turn[1]
    linear = add(command.linear, followed.linear)
    return replace(command, linear=linear, yaw_rate=command.yaw_rate + followed.yaw_rate, turn=turn)

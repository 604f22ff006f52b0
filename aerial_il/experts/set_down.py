"""Base class of experts that take a cube from one place and set it down, upright and gently, in another."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from aerial_il.core.arrays import length, planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.experts.pick_place import (
    AT_HEIGHT_M,
    CARRY_SPEED_M_S,
    DESCENT_LEAD_M,
    DESCENT_PATIENCE_STEPS,
    FINGER_ROOM_M,
    GRIP_PATIENCE_STEPS,
    GRIP_STEPS,
    LIFT_LEAD_M,
    LOST_ALIGNMENT_M,
    LOST_M,
    NOISE_IN_FINE_WORK,
    NOISE_ON_THE_WAY,
)
from aerial_il.suite.props import CUBE_HALF_M

HOVER, DESCEND, CLOSE, LIFT, CARRY, LOWER, RELEASE, RETREAT = range(8)

TRAVEL_M = 0.24  # of the tool over the table while it travels: a cube in it clears the walls of a cabinet
ALIGNED_M, DOWN_M = 0.012, 0.010  # sideways errors at which the open gripper goes down, and at which a cube does
APART_M = 0.05  # farther than this from where it goes down it first rises, then travels
GENTLE_SHARE, GENTLE_M = 0.4, 0.012  # how far below itself a cube is sent: a share of its height, and this
SEATED_M = 0.003  # over where it is to lie, at which it is let go
LOWER_PATIENCE_STEPS = 150  # longer than this on the way down: something is under it
WIDE = 0.9  # share of the opening asked for, from where on it may leave
FACING_COS = np.cos(np.deg2rad(6.0))


class SetDownExpert(Expert):
    """Way-points over the cube and over where it goes; the cube, not the tool, is brought to its place.

    Attributes:
        at_height_m: how far above the cube's middle, at most, the gripper closes.
        down_m: how far beside its place, at most, a cube goes down.
    """

    at_height_m: ClassVar[float] = AT_HEIGHT_M
    down_m: ClassVar[float] = DOWN_M
    phase_names = ("hover", "descend", "close", "lift", "carry", "lower", "release", "retreat")
    travels = (HOVER, CARRY)

    @abstractmethod
    def cube(self) -> np.ndarray:
        """(n, 3) middle of the cube to be taken, world, m."""

    @abstractmethod
    def held(self) -> np.ndarray:
        """(n,) bool: it is between the pads."""

    @abstractmethod
    def grasp_heading(self) -> np.ndarray:
        """(n,) heading of the tool at which its fingers meet two faces of the cube, rad."""

    @abstractmethod
    def goal(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the cube's middle is to lie (n, 3), world, m, and the tool's heading there (n,), rad."""

    @abstractmethod
    def done(self) -> np.ndarray:
        """(n,) bool: the cube lies where it may stay."""

    @abstractmethod
    def table(self) -> float:
        """Height of what it travels over, m."""

    def beside_goal(self) -> np.ndarray:
        """(n,) how far the cube is beside its place, m."""
        return planar_length(self.goal()[0] - self.cube())

    def down(self) -> np.ndarray:
        """(n,) bool: a cube on its way down may be let go."""
        seated = self.cube()[:, 2] - self.goal()[0][:, 2] <= SEATED_M
        return seated | (self.timer > LOWER_PATIENCE_STEPS)

    def astray(self) -> np.ndarray:
        """(n,) bool: a cube on its way down goes up again."""
        return self.beside_goal() > LOST_ALIGNMENT_M

    def first_phase(self) -> np.ndarray:
        return np.where(self.held(), LIFT, np.where(self.done(), RETREAT, HOVER))

    def next_phase(self) -> np.ndarray:
        view, tool, cube = self.view, self.view.tool_pos, self.cube()
        held, beside, beside_goal = self.held(), planar_length(cube - tool), self.beside_goal()
        over, high = (beside <= ALIGNED_M) & self._facing(), tool[:, 2] >= self._travel() - 0.03
        lost = (self.timer > 5) & ~held & (length(cube - tool) > LOST_M)
        ready = (beside_goal <= self.down_m) & (planar_length(view.base_vel) <= CARRY_SPEED_M_S)
        rules = (
            (HOVER, over, DESCEND),
            (DESCEND, (beside > LOST_ALIGNMENT_M) | (self.timer > DESCENT_PATIENCE_STEPS), HOVER),
            (DESCEND, over & (tool[:, 2] - cube[:, 2] <= self.at_height_m), CLOSE),
            (CLOSE, held & (self.timer >= GRIP_STEPS), LIFT),
            (CLOSE, self.timer > GRIP_PATIENCE_STEPS, HOVER),
            (LIFT, lost, HOVER),
            (LIFT, high, CARRY),
            (CARRY, lost, HOVER),
            (CARRY, ready, LOWER),
            (LOWER, self.down(), RELEASE),
            (LOWER, lost, HOVER),
            (LOWER, self.astray(), CARRY),
            (RELEASE, view.gripper[:, 0] >= WIDE * self._narrow(), RETREAT),
            (RETREAT, high & ~self.done(), HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        phase, tool, cube = self.phase, self.view.tool_pos, self.cube()
        goal, goal_heading = self.goal()
        picking, carrying = phase <= CLOSE, (phase == CARRY) | (phase == LOWER)
        low = (phase == HOVER) & (tool[:, 2] < self._travel() - APART_M) & (planar_length(cube - tool) > APART_M)
        aim = np.where(picking[:, None], cube, goal + tool - cube)
        stay = low | (phase == LIFT) | (phase >= RELEASE)
        sideways = np.where(stay[:, None], tool, aim)[:, :2]
        down = tool[:, 2] - DESCENT_LEAD_M
        left = cube[:, 2] - goal[:, 2]
        height = np.select(
            [phase == p for p in range(8)],
            [
                self._travel(),
                np.maximum(cube[:, 2], down),
                cube[:, 2],
                np.minimum(self._travel(), tool[:, 2] + LIFT_LEAD_M + np.maximum(tool[:, 2] - self.table(), 0.0)),
                self._travel(),
                tool[:, 2] - np.minimum(GENTLE_SHARE * np.maximum(left, 0.0) + GENTLE_M, DESCENT_LEAD_M),
                tool[:, 2],
                self._travel(),
            ],
        )
        heading = np.where(picking, self.grasp_heading(), goal_heading)
        heading = np.where(stay & ~carrying, self._heading(), heading)
        opening = np.where((phase >= CLOSE) & (phase <= LOWER), 0.0, self._narrow())
        return np.concatenate([sideways, height[:, None]], axis=1), pointing_down(heading), opening

    def noise_share(self) -> np.ndarray:
        fine = (self.phase == DESCEND) | (self.phase == CLOSE) | (self.phase == LOWER)
        return np.where(fine, NOISE_IN_FINE_WORK, NOISE_ON_THE_WAY)

    def _narrow(self) -> float:
        """Opening of the gripper that leaves some room on both sides of a cube, and little beyond."""
        return min(1.0, (CUBE_HALF_M + FINGER_ROOM_M) / self.view.robot.gripper.stroke)

    def _travel(self) -> np.ndarray:
        """(n,) height of the tool while it travels, m."""
        return np.full(self.view.n, self.table() + TRAVEL_M)

    def _heading(self) -> np.ndarray:
        """(n,) heading of the tool, rad."""
        mat = self.view.tool_mat
        return np.arctan2(-mat[:, 1], mat[:, 4])

    def _facing(self) -> np.ndarray:
        """(n,) bool: the fingers are turned as wanted."""
        return np.cos(self.grasp_heading() - self._heading()) >= FACING_COS


def face_nearest(cube: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Headings (n,) that meet two faces of cubes of yaw ``cube`` (n,), of four the nearest to ``heading`` (n,), rad."""
    quarter = 0.5 * np.pi
    return heading + (cube - heading + 0.5 * quarter) % quarter - 0.5 * quarter

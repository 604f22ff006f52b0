"""Move a segment to where its thing is now."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.generation.segments import Segment
from aerial_il.generation.things import Poses, Thing

LATE_M, LATE_TO_GRIP_M = 0.02, 0.006  # a command waits for a tool that is farther; the second where fingers move
GRIP_SHARE = 0.1  # of the opening that a gripper changes in a step when it moves
LEAST_TRAVEL = 1e-3  # rad or m that a joint moved in the source, for its way to be scaled


@dataclass(frozen=True, eq=False)
class Path:
    """K commands to the tool.

    Attributes:
        pos: (K, 3) m, world. mat: (K, 3, 3) world from tool. gripper: (K,) opening.
        there: (K, 3) m, where the tool is expected when a command is given.
        offset: (K, 3) m, the tool from what it carries; NaN where it carries nothing.
        faced: (K, 3, 3) world from tool, as the tool is expected.
        place: (3,) m, where its thing is then. turn: (3, 3), by which it was turned.
    """

    pos: np.ndarray
    mat: np.ndarray
    gripper: np.ndarray
    there: np.ndarray
    offset: np.ndarray
    faced: np.ndarray
    place: np.ndarray
    turn: np.ndarray

    def __len__(self) -> int:
        return len(self.pos)

    @cached_property
    def grips(self) -> np.ndarray:
        """(K,) bool: after which steps the fingers move."""
        return np.abs(np.diff(self.gripper, append=self.gripper[-1])) > GRIP_SHARE

    @cached_property
    def slack(self) -> np.ndarray:
        """(K,) m, how far the tool may be from where it is expected before a command waits for it."""
        return np.where(self.grips, LATE_TO_GRIP_M, LATE_M)

    def sent(self, step: int) -> np.ndarray:
        """Return where the tool is sent (3,) m: where it is expected before fingers move, so that it gets there."""
        return self.there[step] if self.grips[step] else self.pos[step]

    @property
    def actions(self) -> np.ndarray:
        """(K, 10) at level ``ee_pose``."""
        return np.concatenate([self.pos, rot6d_from_mat(self.mat), self.gripper[:, None]], axis=1)


def moved(segment: Segment, thing: Thing, k: int, now: Poses) -> Path:
    """Return a segment relative to its thing as it is now.

    A thing on a joint is led from where it stands to where the source led it: the way of its joint is scaled.

    Args:
        segment: of a source. thing: in the present scene, number ``k`` there. now: where everything is, one instant.
    """
    if thing.is_jointed:
        turns, places = _led(segment, thing, k, now)
    else:
        turn = _turn(segment, now.mat[0, k])
        turns, places = np.broadcast_to(turn, segment.mat.shape), np.broadcast_to(now.pos[0, k], segment.pos.shape)
    sent, been = (
        places + np.einsum("kij,kj->ki", turns, each - segment.thing_pos) for each in (segment.pos, segment.tool_pos)
    )
    offset = np.full_like(sent, np.nan) if segment.offset is None else np.einsum("kij,kj->ki", turns, segment.offset)
    faced = turns @ segment.tool_mat
    return Path(sent, turns @ segment.mat, segment.gripper, been, offset, faced, places[0], turns[0])


def _turn(segment: Segment, mat: np.ndarray) -> np.ndarray:
    """Return by which rotation (3, 3) a path turns with a thing that is not on a joint."""
    how, before = segment.turning, segment.thing_mat[0]
    if how.how == "not":
        return np.eye(3)
    if how.how == "full":
        return mat @ before.T
    angle, period = _heading(mat) - _heading(before), 2.0 * np.pi / how.fold
    return Rotation.from_euler("z", angle - period * np.round(angle / period)).as_matrix()


def _led(segment: Segment, thing: Thing, k: int, now: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Return how a path turns (K, 3, 3) with a thing on a joint, and where that is (K, 3), step by step."""
    first = segment.joint[0]
    farthest = segment.joint[np.argmax(np.abs(segment.joint - first))]
    here, travel = now.joint[0, k], farthest - first
    scale = (farthest - here) / travel if abs(travel) > LEAST_TRAVEL else 1.0
    ahead = scale * (segment.joint - first)
    axis, anchor, pos, mat = (each[0, k] for each in (now.axis, now.anchor, now.pos, now.mat))
    if thing.kind == "slide":
        mats, places = np.broadcast_to(mat, segment.mat.shape), pos + ahead[:, None] * axis
    else:
        turns = Rotation.from_rotvec(ahead[:, None] * axis).as_matrix()
        mats, places = turns @ mat, anchor + turns @ (pos - anchor)
    return mats @ np.swapaxes(segment.thing_mat, 1, 2), places


def _heading(mat: np.ndarray) -> float:
    return float(np.arctan2(mat[1, 0], mat[0, 0]))

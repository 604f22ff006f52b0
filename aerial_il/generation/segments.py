"""Cut a flight into segments: the tool's path relative to the thing that it deals with."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.generation.cuts import Cut, check_cuts
from aerial_il.generation.moves import Move, carries, cuts_of
from aerial_il.generation.source import Source
from aerial_il.generation.things import Turning, turning_of

SLIPPED_M = 0.02  # that a carried thing moves in the gripper until it is let go


@dataclass(frozen=True, eq=False)
class Segment:
    """K steps of the tool relative to a thing.

    Attributes:
        name: for people. thing: index of it. turning: how the path turns with it. first: step of the source.
        pos: (K, 3) m, where the tool was sent. mat: (K, 3, 3). gripper: (K,). tool_pos: (K, 3), where it was.
        tool_mat: (K, 3, 3).
        thing_pos: (K, 3), thing_mat: (K, 3, 3), joint: (K,) the thing meanwhile; of one that is not on a joint as it
            was at the start.
        held: (3,) m, the thing from the tool, in its frame, when the segment ends with it in the gripper; else None.
        carried: name of a thing that is in the gripper as the segment begins. offset: (K, 3) m, the tool from that,
            while it stays there; NaN afterwards.
    """

    name: str
    thing: int
    turning: Turning
    first: int
    pos: np.ndarray
    mat: np.ndarray
    gripper: np.ndarray
    tool_pos: np.ndarray
    tool_mat: np.ndarray
    thing_pos: np.ndarray
    thing_mat: np.ndarray
    joint: np.ndarray
    held: np.ndarray | None = None
    carried: str = ""
    offset: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.pos)


def cut(source: Source) -> tuple[Segment, ...]:
    """Return the segments of a flight, in their order.

    Raises:
        InvalidValueError: it was cut by hand where it cannot be.
    """
    carried, cuts = carries(source), cuts_of(source)
    try:
        check_cuts(cuts, source.names, len(source))
    except AerialError as error:
        segment = f"aerial-il segment DATASET uid={source.uid}"
        if source.cuts is None:
            raise InvalidValueError(f"No cuts are found in {source.uid}: {error} Cut it by hand: {segment}") from None
        again = f"{segment} cuts=[found]"
        raise InvalidValueError(f"{source.uid} cannot be cut as was said: {error} Take it back: {again}") from None
    return tuple(_segment(source, each, carried) for each in cuts)


def _segment(source: Source, cut: Cut, carried: Iterable[Move]) -> Segment:
    k = source.names.index(cut.thing)
    thing, poses, steps = source.things[k], source.poses, slice(cut.first, cut.last)
    instants = np.arange(cut.first, cut.last) if thing.is_jointed else np.full(cut.last - cut.first, cut.first)
    grasped = any(move.thing == k and move.first < cut.last <= move.last for move in carried)
    brought = next((m.thing for m in carried if m.thing != k and m.first <= cut.first <= m.last), None)
    return Segment(
        thing.name,
        k,
        turning_of(thing, source.spec.observation.of_group("task")),
        cut.first,
        source.pos[steps],
        source.mat[steps],
        source.gripper[steps],
        poses.tool_pos[steps],
        poses.tool_mat[steps],
        poses.pos[instants, k],
        poses.mat[instants, k],
        poses.joint[instants, k],
        held=poses.tool_mat[cut.last].T @ (poses.pos[cut.last, k] - poses.tool_pos[cut.last]) if grasped else None,
        carried="" if brought is None else source.things[brought].name,
        offset=None if brought is None else _offset(source, brought, steps),
    )


def _offset(source: Source, k: int, steps: slice) -> np.ndarray:
    """Return the tool from a thing that it carries (K, 3) m, NaN from where on that is let go."""
    offset = source.poses.tool_pos[steps] - source.poses.pos[steps, k]
    slipped = np.linalg.norm(offset - offset[0], axis=1) > SLIPPED_M
    offset[int(np.argmax(slipped)) if slipped.any() else len(offset) :] = np.nan
    return offset

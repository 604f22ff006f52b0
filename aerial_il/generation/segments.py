"""Cut a flight into segments: the tool's path relative to the thing that it deals with.

What moved tells where. A thing that is grasped and carried gives two segments: from shortly before it moves until it is
clear of where it stood, relative to itself; and from shortly before it comes to rest until the end, relative to what it
was brought to. A thing on a joint gives one, relative to itself. Where nothing moves, the end of the flight is one,
relative to what is nearest to the tool. What lies between is transit, which is planned anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from aerial_il.generation.source import Source
from aerial_il.generation.things import Turning, turning_of

APPROACH_M = 0.10  # of the tool's way before a thing moves that belongs to its segment
CLEAR_M = 0.05  # that a thing is moved at least before it is taken away
ARRIVAL_M = 0.15  # from where a thing comes to rest at which its last segment begins at least
MOVED_M, TURNED_RAD = 0.004, 0.07  # from where it stood: a thing has been moved
CARRIED_M = 0.03
SLIPPED_M = 0.02  # that a carried thing moves in the gripper until it is let go
REST_STEPS = 25  # without motion between two attempts


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


@dataclass(frozen=True)
class Move:
    """A thing was moved, by the index of it, from step ``first`` on, and lay still again at ``last``."""

    thing: int
    first: int
    last: int


def cut(source: Source) -> tuple[Segment, ...]:
    """Return the segments of a flight, in their order."""
    moves = sorted(_moves(source), key=lambda move: move.first)
    if not moves:
        return (_at_the_end(source),)
    starts = [_approach(source, move.first) for move in moves]
    ends = [*starts[1:], len(source)]
    found: list[Segment] = []
    for move, start, end in zip(moves, starts, ends, strict=True):
        found += _segments_of(source, move, start, max(end, start + 1))
    return tuple(found)


def _segments_of(source: Source, move: Move, start: int, end: int) -> Iterator[Segment]:
    thing = source.things[move.thing]
    if thing.is_jointed:
        yield _segment(source, move.thing, start, end)
        return
    path = source.poses.pos[:, move.thing]
    target = _target(source, move)
    if target is None:
        yield _segment(source, move.thing, start, end)
        return
    clear = _first(np.linalg.norm(path - path[start], axis=1) > max(CLEAR_M, thing.size_m), move.first, move.last)
    final = path[move.last]
    far = np.linalg.norm(path[: move.last + 1] - final, axis=1) > max(ARRIVAL_M, thing.size_m + CLEAR_M)
    arrival = max(clear, int(np.flatnonzero(far)[-1]) if far.any() else clear)
    tool = source.poses.tool_mat[clear].T @ (path[clear] - source.poses.tool_pos[clear])
    yield replace(_segment(source, move.thing, start, clear), held=tool)
    offset = source.poses.tool_pos[arrival:end] - path[arrival:end]
    slipped = np.linalg.norm(offset - offset[0], axis=1) > SLIPPED_M
    offset[int(np.argmax(slipped)) if slipped.any() else end :] = np.nan
    yield replace(_segment(source, target, arrival, end), carried=thing.name, offset=offset)


def _segment(source: Source, k: int, start: int, end: int) -> Segment:
    thing, poses, steps = source.things[k], source.poses, slice(start, end)
    instants = np.arange(start, end) if thing.is_jointed else np.full(end - start, start)
    return Segment(
        thing.name,
        k,
        turning_of(thing, source.spec.observation.of_group("task")),
        start,
        source.pos[steps],
        source.mat[steps],
        source.gripper[steps],
        poses.tool_pos[steps],
        poses.tool_mat[steps],
        poses.pos[instants, k],
        poses.mat[instants, k],
        poses.joint[instants, k],
    )


def _at_the_end(source: Source) -> Segment:
    """Return the segment of a flight that moved nothing."""
    tool = source.poses.tool_pos
    distances = np.linalg.norm(source.poses.pos[-1] - tool[-1], axis=1)
    return _segment(source, int(np.argmin(distances)), _approach(source, len(source)), len(source))


def _approach(source: Source, step: int) -> int:
    """Return from which step on the tool stayed within ``APPROACH_M`` of where it is at ``step``."""
    tool = source.poses.tool_pos
    away = np.linalg.norm(tool[: step + 1] - tool[step], axis=1) > APPROACH_M
    return int(np.flatnonzero(away)[-1]) if away.any() else 0


def _target(source: Source, move: Move) -> int | None:
    """Return what a carried thing was brought to: of what stands still, the nearest to where it came to rest."""
    where = source.poses.pos[move.last]
    distances = np.linalg.norm(where - where[move.thing], axis=1)
    still = [k for k, thing in enumerate(source.things) if thing.kind == "placed" and k != move.thing]
    return min(still, key=lambda k: distances[k], default=None)


def _moves(source: Source) -> Iterator[Move]:
    for k, thing in enumerate(source.things):
        if thing.kind == "placed":
            continue
        spans = list(_spans(source, k))
        if not spans:
            continue
        if thing.is_jointed:
            yield Move(k, spans[0][0], spans[-1][1])
        else:
            yield from (Move(k, *span) for span in spans[-1:] if _carried(source, k, *span) > CARRIED_M)


def _spans(source: Source, k: int) -> Iterator[tuple[int, int]]:
    """Yield the first and last step of each time that a thing moves, those that follow closely as one."""
    pos, mat, still = source.poses.pos[:, k], source.poses.mat[:, k], 0
    moving = np.zeros(len(pos), bool)
    for step in range(len(pos)):
        turned = np.arccos(np.clip((np.trace(mat[still].T @ mat[step]) - 1.0) / 2.0, -1.0, 1.0))
        if np.linalg.norm(pos[step] - pos[still]) > MOVED_M or turned > TURNED_RAD:
            moving[still + 1 : step + 1], still = True, step
        elif step - still > REST_STEPS:
            still = step
    steps = np.flatnonzero(moving)
    breaks = np.flatnonzero(np.diff(steps) > REST_STEPS)
    edges = [0, *(breaks + 1), len(steps)]
    yield from ((int(steps[a]), int(steps[b - 1])) for a, b in pairwise(edges) if b > a)


def _carried(source: Source, k: int, first: int, last: int) -> float:
    path = source.poses.pos[:, k]
    return float(np.linalg.norm(path[last] - path[max(first - 1, 0)]))


def _first(condition: np.ndarray, start: int, otherwise: int) -> int:
    """Return the first step from ``start`` on where ``condition`` (T,) holds."""
    found = np.flatnonzero(condition[start:])
    return start + int(found[0]) if found.size else otherwise

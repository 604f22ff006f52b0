"""Find where a flight is to be cut, by what moved.

A thing that is grasped and carried gives two cuts: from shortly before it moves until it is clear of where it stood,
about itself; and from shortly before it comes to rest until the end, about what it was brought to. A thing on a joint
gives one, about itself. Where nothing moves, the end of the flight is one, about what is nearest to the tool. What lies
between is transit, which is planned anew.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from aerial_il.generation.cuts import Cut, at_phases, check_cuts, read_cut
from aerial_il.generation.source import Source

APPROACH_M = 0.10  # of the tool's way before a thing moves that belongs to its segment
CLEAR_M = 0.05  # that a thing is moved at least before it is taken away
ARRIVAL_M = 0.15  # from where a thing comes to rest at which its last segment begins at least
MOVED_M, TURNED_RAD = 0.004, 0.07  # from where it stood: a thing has been moved
CARRIED_M = 0.03
REST_STEPS = 25  # without motion between two attempts


@dataclass(frozen=True)
class Move:
    """A thing was moved, by the index of it, from step ``first`` on, and lay still again at ``last``."""

    thing: int
    first: int
    last: int


def cuts_of(source: Source) -> tuple[Cut, ...]:
    """Return where a flight is cut: as a person says, or as it is found."""
    return find_cuts(source) if source.cuts is None else source.cuts


def read_cuts(source: Source, words: Sequence[str]) -> tuple[Cut, ...]:
    """Return cuts of a flight as they are typed; ``phases`` for those that are found, where phases begin or end.

    Raises:
        InvalidValueError, UnknownNameError: it cannot be cut so.
    """
    if list(words) == ["phases"]:
        cuts = at_phases(find_cuts(source), {*source.phases, len(source)} if source.phases else ())
    else:
        cuts = tuple(map(read_cut, words))
    check_cuts(cuts, source.names, len(source))
    return cuts


def find_cuts(source: Source) -> tuple[Cut, ...]:
    """Return the cuts of a flight, in their order."""
    moves = sorted(_moves(source), key=lambda move: move.first)
    if not moves:
        return (_at_the_end(source),)
    starts = [_approach(source, move.first) for move in moves]
    ends = [*starts[1:], len(source)]
    cuts = (_cuts_of(source, *each) for each in zip(moves, starts, ends, strict=True))
    return _one_after_the_other([cut for each in cuts for cut in each])


def _one_after_the_other(cuts: Sequence[Cut]) -> tuple[Cut, ...]:
    """Return cuts, each ended where the next begins; of moves that overlap, nothing may be left of one."""
    found = list[Cut]()
    for cut in cuts:
        first = max(cut.first, found[-1].first + 1 if found else 0)
        if first < cut.last:
            if found and found[-1].last > first:
                found[-1] = replace(found[-1], last=first)
            found.append(replace(cut, first=first))
    return tuple(found)


def carries(source: Source) -> list[Move]:
    """Return each time that a thing was carried."""
    free = (k for k, thing in enumerate(source.things) if thing.kind == "free")
    moves = (Move(k, *span) for k in free for span in _spans(source, k))
    return [move for move in moves if _carried(source, move) > CARRIED_M]


def _cuts_of(source: Source, move: Move, start: int, end: int) -> Iterator[Cut]:
    thing, end = source.things[move.thing], max(end, start + 1)
    target = None if thing.is_jointed else _target(source, move)
    if target is None:
        yield Cut(thing.name, start, end)
        return
    path = source.poses.pos[:, move.thing]
    clear = _first(np.linalg.norm(path - path[start], axis=1) > max(CLEAR_M, thing.size_m), move.first, move.last)
    final = path[move.last]
    far = np.linalg.norm(path[: move.last + 1] - final, axis=1) > max(ARRIVAL_M, thing.size_m + CLEAR_M)
    arrival = max(clear, int(np.flatnonzero(far)[-1]) if far.any() else clear)
    yield Cut(thing.name, start, clear)
    yield Cut(target, arrival, end)


def _at_the_end(source: Source) -> Cut:
    """Return the cut of a flight that moved nothing."""
    tool = source.poses.tool_pos
    distances = np.linalg.norm(source.poses.pos[-1] - tool[-1], axis=1)
    return Cut(source.things[int(np.argmin(distances))].name, _approach(source, len(source)), len(source))


def _approach(source: Source, step: int) -> int:
    """Return from which step on the tool stayed within ``APPROACH_M`` of where it is at ``step``."""
    tool = source.poses.tool_pos
    away = np.linalg.norm(tool[: step + 1] - tool[step], axis=1) > APPROACH_M
    return int(np.flatnonzero(away)[-1]) if away.any() else 0


def _target(source: Source, move: Move) -> str | None:
    """Name what a carried thing was brought to: of what stands still, the nearest to where it came to rest."""
    where = source.poses.pos[move.last]
    distances = np.linalg.norm(where - where[move.thing], axis=1)
    still = [k for k, thing in enumerate(source.things) if thing.kind == "placed" and k != move.thing]
    return source.things[min(still, key=lambda k: distances[k])].name if still else None


def _moves(source: Source) -> Iterator[Move]:
    """Yield the moves that a flight is cut by: of attempts to carry a thing, the last."""
    carried = {move.thing: move for move in carries(source)}
    for k, thing in enumerate(source.things):
        if thing.is_jointed and (spans := list(_spans(source, k))):
            yield Move(k, spans[0][0], spans[-1][1])
        elif k in carried:
            yield carried[k]


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


def _carried(source: Source, move: Move) -> float:
    """Return how far a move has brought its thing, m."""
    path = source.poses.pos[:, move.thing]
    return float(np.linalg.norm(path[move.last] - path[max(move.first - 1, 0)]))


def _first(condition: np.ndarray, start: int, otherwise: int) -> int:
    """Return the first step from ``start`` on where ``condition`` (T,) holds."""
    found = np.flatnonzero(condition[start:])
    return start + int(found[0]) if found.size else otherwise

"""Two flights on one timeline: the second one's time is stretched until its milestones fall on the first one's."""

from dataclasses import dataclass

import numpy as np

from aerial_il.presentation.rerun.flight import Flight
from aerial_il.presentation.rerun.log import Clock
from aerial_il.presentation.rerun.signals import phase_names


@dataclass(frozen=True, eq=False)
class Alignment:
    """Clocks of two flights that share a third timeline.

    Attributes:
        first, second: their clocks. by: what was aligned: ``phases``, ``sub-tasks`` or ``start and end``.
        milestones: the names of what both went through, in order.
    """

    first: Clock
    second: Clock
    by: str
    milestones: tuple[str, ...]


def align(first: Flight, second: Flight) -> Alignment:
    """Align two flights by the starts of their phases; by sub-tasks where a flight has none; else by the ends."""
    for by, moments in (("phases", phase_starts), ("sub-tasks", subtask_times)):
        one, other = moments(first), moments(second)
        if names := common(one, other):
            return Alignment(*_clocks(first, second, [(one[n], other[n]) for n in names]), by, tuple(names))
    return Alignment(*_clocks(first, second, []), "start and end", ())


def phase_starts(flight: Flight) -> dict[str, float]:
    """Return when each phase began for the first time, s."""
    phases = phase_names(flight.episode)
    if phases is None:
        return {}
    names, first = np.unique(phases, return_index=True)
    return {str(name): float(flight.episode.sim_time[step]) for name, step in zip(names, first, strict=True)}


def subtask_times(flight: Flight) -> dict[str, float]:
    """Return when each sub-task was fulfilled for the first time, s."""
    if flight.flags is None:
        return {}
    done = flight.flags > 0
    names = flight.episode.spec.subtasks
    times = flight.episode.sim_time
    return {name: float(times[1 + int(np.argmax(done[:, k]))]) for k, name in enumerate(names) if done[:, k].any()}


def common(one: dict[str, float], other: dict[str, float]) -> list[str]:
    """Return what both went through, in the first one's order; what the second did in another order is left out."""
    shared: list[str] = []
    for name in sorted(one.keys() & other.keys(), key=one.__getitem__):
        later = not shared or (one[name] > one[shared[-1]] and other[name] > other[shared[-1]])
        if later and (one[name] > 0.0) == (other[name] > 0.0):
            shared.append(name)
    return shared


def _clocks(first: Flight, second: Flight, pairs: list[tuple[float, float]]) -> tuple[Clock, Clock]:
    """Return the clocks; between two milestones time passes evenly."""
    ours, theirs = first.episode.sim_time, second.episode.sim_time
    inner = [(a, b) for a, b in pairs if 0.0 < a < ours[-1] and 0.0 < b < theirs[-1]]
    at = np.array([(0.0, 0.0), *inner, (ours[-1], theirs[-1])])
    return Clock(ours, aligned=ours), Clock(theirs, aligned=np.interp(theirs, at[:, 1], at[:, 0]))

"""What follows from what is estimated: found in the data, so that all that is known of one thing agrees.

A task shows where a cube is, and also how far it is from the tool and the bowl from it. Only the places need to be
estimated; of one that rests and is shown only by how far it is from another, where it is. Which displacements are sums
of places, of the tool's pose and of axes, with which coefficients, is read off the demonstrations by least squares: it
holds in every step, or it is none. Likewise no single image shows how fast a door turns, nor where a ball will be:
which fields are rates of others is read off how these change, and several points in one field, such as where something
will be soon, are the nearest sums of places and velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.core.contracts import Observation
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.policies.parts.relative import rotations

EXACT_M = 1e-3  # root mean square of what a sum may miss
RESTS = 0.1  # most that the end of a displacement may roam, as a share of what the displacement does
EXPLAINED = 0.8  # least share of a rate's square that changes of its field explain: some rates are smoothed
HORIZON = 10  # steps over which a rate's drift is measured: what changes it goes on for more than one
TOOL = ("ee_pos", "ee_rot6d")
CALLED = "_pos"  # ends the names of places; other vectors of a length lead from one to another
AXES = ("tool x", "tool y", "tool z")


@dataclass(frozen=True)
class Sum:
    """A field that is a sum of others: ``terms``, each a source and its coefficient.

    A field of several points has as many sums, in their order.
    """

    field: str
    terms: tuple[tuple[str, float], ...]

    def of(self, sources: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the field, or a point of it, (n, 3)."""
        return np.sum([factor * sources[name] for name, factor in self.terms], axis=0)


@dataclass(frozen=True)
class Rate:
    """A field that is the rate of another: ``factor`` times what ``of`` changes by in a control step.

    Attributes:
        square: mean square of it in the demonstrations. drift: by which the square of its change grows in a step.
    """

    field: str
    of: str
    factor: float
    square: float
    drift: float


def places_of(spec: ObservationSpec) -> tuple[str, ...]:
    """Return the fields to be seen that are points or displacements in the world, m; those called places first."""
    found = [n for n in spec.to_be_seen if (spec[n].shape, spec[n].unit, spec[n].frame) == ((3,), "m", "world")]
    return tuple(sorted(found, key=lambda name: not name.endswith(CALLED)))


def axes_of(spec: ObservationSpec) -> tuple[str, ...]:
    """Return the fields to be seen that are unit vectors in the world."""
    return tuple(n for n in spec.to_be_seen if (spec[n].shape, spec[n].unit, spec[n].frame) == ((3,), "", "world"))


def find_sums(spec: ObservationSpec, obs: Observation) -> tuple[Sum, ...]:
    """Return the places that follow from those before them, from unit vectors and from the tool.

    Args:
        spec: of the observations. obs: ``name -> (n, ...)`` of steps of several flights.
    """
    sources, found = dict(sources_of(obs, axes_of(spec))), list[Sum]()
    for name in places_of(spec):
        names = tuple(sources)
        terms = _solved(np.stack([sources[each].ravel() for each in names], axis=1), obs[name].ravel())
        if terms is None or not terms.any():  # of nothing, it never left zero
            sources[name] = obs[name]
        else:
            found.append(Sum(name, tuple((n, float(c)) for n, c in zip(names, terms, strict=True) if c)))
    return tuple(found)


def find_ends(flights: Sequence[Observation], names: Sequence[str]) -> dict[str, Sum]:
    """Return which displacements lead to something that rests, each as the place of that less where it leads from.

    Args:
        flights: ``name -> (T, 3)`` of whole flights. names: places and displacements; those are called ``_pos``.
    """
    found, starts = dict[str, Sum](), [n for n in names if n.endswith(CALLED)]
    for name in (n for n in names if not n.endswith(CALLED)):
        roams = _roams(flights, name)
        rests = [start for start in starts if _roams(flights, name, start) < RESTS * roams]
        if rests and roams > EXACT_M:
            found[name] = Sum(name, ((f"end of {name}", 1.0), (rests[0], -1.0)))
    return found


def added(obs: Observation, names: Sequence[str]) -> np.ndarray:
    """Return the sum of some fields (n, D)."""
    return np.sum([obs[name] for name in names], axis=0)


def _roams(flights: Sequence[Observation], *names: str) -> float:
    """Return the root mean square by which a sum of fields leaves its mean of a flight, m."""
    sums = [added(each, names) for each in flights]
    return float(np.sqrt(np.mean(np.concatenate([np.sum((each - each.mean(0)) ** 2, axis=1) for each in sums]))))


def find_points(spec: ObservationSpec, obs: Observation, names: Sequence[str]) -> tuple[Sum, ...]:
    """Return for each point of the fields that have several the sum that comes nearest to it, however near that is.

    Args:
        spec: of the observations. obs: ``name -> (n, ...)``. names: places and velocities that are known, (n, 3) each.
    """
    sources = {name: obs[name] for name in (TOOL[0], *names) if name in obs}
    columns, found = np.stack([each.ravel() for each in sources.values()], axis=1), list[Sum]()
    for name in (n for n in spec.to_be_seen if names and _has_points(spec[n])):
        for start in range(0, spec[name].size, 3):
            terms = np.linalg.lstsq(columns, obs[name][:, start : start + 3].ravel(), rcond=1e-6)[0]
            found.append(Sum(name, tuple(zip(sources, map(float, terms), strict=True))))
    return tuple(found)


def _has_points(field: Field) -> bool:
    return (field.unit, field.frame) == ("m", "world") and field.size > 3 and field.size % 3 == 0


def find_rates(spec: ObservationSpec, flights: Sequence[Observation], names: Sequence[str]) -> tuple[Rate, ...]:
    """Return which of ``names`` are rates of others of them, each of the one whose changes explain it best.

    Args:
        spec: of the observations. flights: ``name -> (T, D)`` of whole flights, in the order of time.
    """
    flights, found = [each for each in flights if len(each["ee_pos"]) > 1], list[Rate]()
    for rate in (name for name in names if spec[name].unit.endswith("/s")):
        whose = [n for n in names if (f"{spec[n].unit}/s", spec[n].shape) == (spec[rate].unit, spec[rate].shape)]
        share, factor, name = max(((*_explained(flights, rate, n), n) for n in whose), default=(0.0, 0.0, ""))
        if share >= EXPLAINED:
            values = [each[rate] for each in flights]
            ahead = min(HORIZON, min(map(len, values)) - 1)
            drift = np.mean(np.concatenate([each[ahead:] - each[:-ahead] for each in values]) ** 2) / ahead
            square = np.mean(np.concatenate(values) ** 2)
            found.append(Rate(rate, name, factor, float(square), float(drift)))
    return tuple(found)


def _explained(flights: Sequence[Observation], rate: str, of: str) -> tuple[float, float]:
    """Return the share of a rate's mean square that changes of a field explain, and by which factor."""
    values = np.concatenate([each[rate].ravel() for each in flights])
    changes = np.concatenate([np.gradient(each[of], axis=0).ravel() for each in flights])
    factor = float(changes @ values / max(changes @ changes, 1e-12))
    return 1.0 - float(np.sum((values - factor * changes) ** 2) / max(values @ values, 1e-12)), factor


def sources_of(obs: Observation, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the tool's position and axes, and the fields of ``names``, each (n, 3)."""
    tool = rotations(obs[TOOL[1]]) if TOOL[1] in obs else np.zeros((0, 3, 3))
    own = {TOOL[0]: obs[TOOL[0]], **dict(zip(AXES, np.moveaxis(tool, 2, 0), strict=True))} if len(tool) else {}
    return {**own, **{name: obs[name] for name in names}}


def _solved(columns: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Return coefficients with which columns (3 n, k) sum up to ``values`` (3 n,), or None: they do not."""
    if not columns.size:
        return None
    terms = np.linalg.lstsq(columns, values, rcond=1e-6)[0]
    whole = np.round(terms)
    terms = np.where(np.abs(terms - whole) < 1e-3, whole, terms)
    missed = columns @ terms - values
    return terms if np.sqrt(3.0 * np.mean(missed**2)) < EXACT_M else None

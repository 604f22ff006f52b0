"""What is estimated from images, field by field, and in which terms a camera tells it.

The specification of the observations decides, no task does. A point in the world, ``NAME_pos``, is told as where it
lies in the image and how far away, with whether it is in the image at all. A rotation, an axis or a heading is told as
the camera sees it, turned with the camera. All else, such as how far a button is pressed, is told as it is. Of the way
from one place to another that is not shown itself, such as the end of a rail, that other place is told. What never
varies is not estimated, and what follows from other fields or from their changes is computed (see :mod:`.relations`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from aerial_il.core.contracts import Observation
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.policies.parts.normaliser import hardly_varies
from aerial_il.policies.parts.relative import rotations, turned
from aerial_il.policies.perception.cameras import Camera, Pose
from aerial_il.policies.perception.relations import (
    CALLED,
    Rate,
    Sum,
    added,
    find_ends,
    find_points,
    find_rates,
    find_sums,
    places_of,
)

Kind = Literal["place", "rotation", "heading", "number"]
PLACE, ROTATION, HEADING, NUMBER = "place", "rotation", "heading", "number"
FARTHEST = 6.0  # deviations of the demonstrations: beyond, as after a crash, numbers are not told apart


@dataclass(frozen=True, eq=False)
class Target:
    """What is estimated: a field, or the place where a displacement ends.

    Attributes:
        field: its name. kind: in which terms. size: numbers that it has. fold: of a heading, by which the yaw is
            multiplied in it.
        centre, scale: (size,) of the field in the demonstrations, in the world.
        drift: (size,) mean square by which it changes from one step to the next.
        parts: the observed fields that add up to it: itself, or a place and the displacement from there.
    """

    field: str
    kind: Kind
    size: int
    fold: int
    centre: np.ndarray
    scale: np.ndarray
    drift: np.ndarray
    parts: tuple[str, ...]

    def values(self, obs: Observation) -> np.ndarray:
        """Return what it is (n, size) in observations that know it."""
        return added(obs, self.parts)

    def encode(self, values: np.ndarray, pose: Pose, camera: Camera) -> np.ndarray:
        """Return (n, size) what a camera is to tell of the field's values (n, size)."""
        if self.kind == PLACE:
            return camera.project(pose.seen(values))
        if self.kind == ROTATION:
            return turned(np.swapaxes(pose.rot, 1, 2), values)
        if self.kind == HEADING:
            return _rotated(values, -self.fold * yaw_of(pose))
        return np.clip((values - self.centre) / self.scale, -FARTHEST, FARTHEST)

    def decode(self, told: np.ndarray, pose: Pose) -> np.ndarray:
        """Return the values (n, size) of a field that is no place, as a camera tells of them."""
        if self.kind == ROTATION:
            return turned(pose.rot, told)
        if self.kind == HEADING:
            return _rotated(told, self.fold * yaw_of(pose))
        return told * self.scale + self.centre

    def straightened(self, values: np.ndarray) -> np.ndarray:
        """Return the nearest values (n, size) that the field can have."""
        if self.kind == ROTATION and self.size == 6:
            rot = rotations(values)
            return np.concatenate([rot[..., 0], rot[..., 1]], axis=-1)
        if self.kind in (ROTATION, HEADING):
            return values / np.maximum(np.linalg.norm(values, axis=-1, keepdims=True), 1e-6)
        return values

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        own = {"field": self.field, "kind": self.kind, "size": self.size, "fold": self.fold, "parts": [*self.parts]}
        return {**own, **{name: getattr(self, name).tolist() for name in ("centre", "scale", "drift")}}

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> Target:
        """Undo :meth:`to_dict`."""
        numbers = {name: np.array(raw[name], float) for name in ("centre", "scale", "drift")}
        parts = tuple(raw.get("parts", (raw["field"],)))
        return Target(raw["field"], raw["kind"], int(raw["size"]), int(raw["fold"]), **numbers, parts=parts)


@dataclass(frozen=True, eq=False)
class Targets:
    """All that is to be known of what a robot has to look for.

    Attributes:
        estimated: from images. sums: computed from these. constant: field -> its value, which never varied.
        rates: of estimated fields, told by how these change.
    """

    estimated: tuple[Target, ...]
    sums: tuple[Sum, ...]
    constant: Mapping[str, np.ndarray]
    rates: tuple[Rate, ...] = ()

    @staticmethod
    def of(spec: ObservationSpec, flights: Sequence[Observation], names: Sequence[str]) -> Targets:
        """Return what is estimated for a policy that sees the fields ``names``.

        Args:
            spec: of the observations. flights: ``name -> (T, ...)`` of whole flights, in the order of time.
        """
        joined = {n: np.concatenate([each[n] for each in flights]) for n in spec.state_names}
        sums = find_sums(spec, joined)
        shown = [name for name in spec.to_be_seen if name not in {each.field for each in sums}]
        rates = find_rates(spec, flights, shown)
        known = [n for n in shown if spec[n].shape == (3,) and (_kind(spec[n])[0] == PLACE or n in _fields(rates))]
        sums = tuple(each for each in (*sums, *find_points(spec, joined, known)) if each.field in names)
        used = {source for each in sums for source, _ in each.terms} | {*names}
        rates = tuple(each for each in rates if each.field in used)
        ends = find_ends(flights, [n for n in places_of(spec) if n in shown])
        ends = {n: each for n, each in ends.items() if n in used and n not in {r.of for r in rates}}
        used |= {source for each in ends.values() for source, _ in each.terms}
        told = [n for n in shown if n in used | {r.of for r in rates} and n not in _fields((*rates, *sums))]
        constant = {n: joined[n].mean(0) for n in told if hardly_varies(*_extent(joined[n])).all()}
        estimated = tuple(_target(spec[n], flights, ends.get(n)) for n in told if n not in constant)
        return Targets(estimated, (*ends.values(), *sums), constant, rates)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "estimated": [each.to_dict() for each in self.estimated],
            "sums": [{"field": each.field, "terms": [list(term) for term in each.terms]} for each in self.sums],
            "constant": {name: value.tolist() for name, value in self.constant.items()},
            "rates": [asdict(each) for each in self.rates],
        }

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> Targets:
        """Undo :meth:`to_dict`."""
        sums = (Sum(each["field"], tuple((str(n), float(c)) for n, c in each["terms"])) for each in raw["sums"])
        constant = {name: np.array(value, float) for name, value in raw["constant"].items()}
        rates = (Rate(**each) for each in raw.get("rates", ()))
        return Targets(tuple(map(Target.from_dict, raw["estimated"])), tuple(sums), constant, tuple(rates))


def yaw_of(pose: Pose) -> np.ndarray:
    """Return (n,) rad, how far the right of a camera's image is turned about the vertical."""
    return np.arctan2(pose.rot[:, 1, 0], pose.rot[:, 0, 0])


def _target(field: Field, flights: Sequence[Observation], end: Sum | None) -> Target:
    """Return the target of a field, or of where it ends if it is a displacement."""
    name, parts = (field.name, (field.name,)) if end is None else (end.terms[0][0], (end.terms[1][0], field.name))
    each = [added(flight, parts) for flight in flights]
    values = np.concatenate(each)
    steps = np.concatenate([np.diff(one, axis=0) for one in each if len(one) > 1] or [np.zeros_like(values[:1])])
    kind, fold = _kind(field) if end is None else (PLACE, 1)
    scale = np.maximum(values.std(0), 1e-6)
    return Target(name, kind, field.size, fold, values.mean(0), scale, np.mean(steps**2, axis=0), parts)


def _kind(field: Field) -> tuple[Kind, int]:
    """Return in which terms a field is told, and by which its yaw is multiplied."""
    if (field.shape, field.unit, field.frame) == ((3,), "m", "world") and field.name.endswith(CALLED):
        return PLACE, 1
    if field.unit == "" and (field.name.endswith("_rot6d") or (field.shape, field.frame) == ((3,), "world")):
        return ROTATION, 1
    if (field.shape, field.unit, field.frame) == ((2,), "", "world"):
        folds = re.fullmatch(r"cos(\d*)", field.labels[0]) if field.labels else None
        return HEADING, int(folds[1] or 1) if folds else 1
    return NUMBER, 1


def _fields(found: Sequence[Rate | Sum]) -> set[str]:
    return {each.field for each in found}


def _extent(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values.std(0), np.abs(values).mean(0)


def _rotated(pairs: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return pairs (n, 2) of cosine and sine after a turn by ``angle`` (n,) rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * pairs[:, 0] - sin * pairs[:, 1], sin * pairs[:, 0] + cos * pairs[:, 1]], axis=1)

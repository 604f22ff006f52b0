"""Specifications of observations and actions: named, sized and bounded, so that data and policies can check them.

A dataset and a checkpoint carry the :class:`EnvSpec` they were made for; comparing two of them is how a policy
refuses another robot's data and a recording refuses another task's environment.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from aerial_il.core.errors import InvalidValueError, UnknownNameError

Group = Literal["proprio", "task", "image"]
Observations = Literal["truth", "onboard"]  # what a policy acts on: all that the simulator knows, or a robot's own
CONDITIONS = ("tier", "disturbances", "controller", "options")  # of a specification: what may change under a policy
FIRST_NAMED = ("robot", "task", "tier", "controller", "action.level")  # of what differs between two
DESCRIBES = (
    "frame",
    "meaning",
    "noise",
    "real",
    "onboard",
    "instruction",
)  # a field or a task, and may be said otherwise
UNKNOWN = "unknown"  # what a foreign dataset does not tell
NO_CONTROLLER = "none"  # of environments from outside the suite, whose actions are their own


@dataclass(frozen=True)
class Field:
    """One named entry of an observation.

    Attributes:
        name: key in the observation mapping.
        shape: shape of one world's value, without the world axis.
        group: ``proprio`` (the robot's own state), ``task`` (objects and goals) or ``image``.
        dtype: NumPy dtype name.
        unit: SI unit, empty if dimensionless.
        labels: one label per element for one-dimensional fields.
        frame: in which it is given, e.g. ``world``; ``world from tool`` for a rotation; empty where none matters.
        meaning: what it is, a clause. noise: how it differs from the truth, and when. real: a robot could measure it.
            onboard: of a task's field, that a robot knows it without looking, such as what it feels or is told. These
            five describe the field; two that differ in nothing else are alike.
        every: control steps from one image to the next; it is shown until then. delay: control steps between an image
            and its being shown.
    """

    name: str
    shape: tuple[int, ...]
    group: Group = "proprio"
    dtype: str = "float64"
    unit: str = ""
    labels: tuple[str, ...] = ()
    frame: str = field(default="", compare=False)
    meaning: str = field(default="", compare=False)
    noise: str = field(default="", compare=False)
    real: bool = field(default=True, compare=False)
    onboard: bool = field(default=False, compare=False)
    every: int = 1
    delay: int = 0

    @property
    def is_onboard(self) -> bool:
        """Whether a robot has it by itself: what it measures of itself, feels, is told, or its cameras' images."""
        return self.group != "task" or self.onboard

    @property
    def size(self) -> int:
        return int(np.prod(self.shape))

    @property
    def is_colour(self) -> bool:
        """Whether it is a colour image, (H, W, 3) uint8; depth is (H, W) float metres, segmentation (H, W) ids."""
        return self.group == "image" and self.dtype == "uint8" and self.shape[2:] == (3,)

    @property
    def is_depth(self) -> bool:
        """Whether it is a depth image, (H, W) float metres."""
        return self.group == "image" and self.dtype == "float32" and len(self.shape) == 2

    def taken_at(self, steps: ArrayLike) -> np.ndarray:
        """Return in which control steps of an episode the images were taken that are shown in ``steps``."""
        return np.maximum(np.asarray(steps) - self.delay, 0) // self.every * self.every

    def element_labels(self) -> tuple[str, ...]:
        """One label per element: ``name.label``, or ``name.index`` where the field has no labels."""
        labels = self.labels or tuple(str(i) for i in range(self.size))
        return tuple(f"{self.name}.{label}" for label in labels)


def image_name(camera: str) -> str:
    """Return what the colour image of ``camera`` is called: a name alone, its :class:`Field` says what it shows."""
    return f"{camera}_rgb"


def camera_name(image: str) -> str:
    """Return the camera whose colour image :func:`image_name` called so."""
    return image.removesuffix("_rgb")


def camera_text(field: Field, dt_s: float) -> str:
    """Write an image as ``cameras`` asks for it, e.g. ``wrist:depth@64x64@25Hz@40ms``; ``dt_s``: a control step."""
    name = camera_name(field.name) if field.is_colour else ":".join(field.name.rsplit("_", 1))
    height, width = field.shape[:2]
    rate = f"@{1.0 / (field.every * dt_s):.4g}Hz" if field.every > 1 else ""
    late = f"@{1000 * field.delay * dt_s:g}ms" if field.delay else ""
    return f"{name}@{height}x{width}{rate}{late}"


@dataclass(frozen=True)
class ObservationSpec:
    """The ordered fields of an observation mapping ``name -> (n, *shape)``."""

    fields: tuple[Field, ...]

    def __repr__(self) -> str:
        fields = (f"{field.name} {field.shape} {field.unit}".rstrip() for field in self.fields)
        return f"ObservationSpec({', '.join(fields)})"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f.name for f in self.fields)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of all fields that are not images: proprioception first, then the task's."""
        return tuple(f.name for g in ("proprio", "task") for f in self.fields if f.group == g)

    @property
    def to_be_seen(self) -> tuple[str, ...]:
        """Names of what a robot has to look for: where objects are and how they stand."""
        return tuple(f.name for f in self.fields if not f.is_onboard)

    def of_group(self, group: Group) -> tuple[Field, ...]:
        return tuple(f for f in self.fields if f.group == group)

    def __getitem__(self, name: str) -> Field:
        for f in self.fields:
            if f.name == name:
                return f
        raise UnknownNameError("observation", name, self.names)

    def size(self, names: Iterable[str]) -> int:
        return sum(self[name].size for name in names)

    def parts(self, names: Iterable[str]) -> dict[str, slice]:
        """Slice of each one-dimensional field in what :meth:`flatten` returns."""
        ends = np.cumsum([self[name].size for name in names])
        return {name: slice(int(end) - self[name].size, int(end)) for name, end in zip(names, ends, strict=True)}

    def flatten(self, obs: Mapping[str, np.ndarray], names: Iterable[str]) -> np.ndarray:
        """Concatenate fields along the last axis.

        Args:
            obs: mapping ``name -> (..., *shape)``.
            names: which fields, in order.

        Returns:
            ``(..., D)`` with D the sum of the fields' sizes.
        """
        parts = []
        for name in names:
            rank = len(self[name].shape)
            value = np.asarray(obs[name])
            parts.append(value.reshape((*value.shape[: value.ndim - rank], -1)))
        return np.concatenate(parts, axis=-1)


@dataclass(frozen=True, eq=False)
class ActionSpec:
    """A bounded action vector in SI units.

    Attributes:
        level: name of the action level, e.g. ``ee_pose``.
        labels: one label per element.
        units: one unit per element.
        low: (Da,) lower bounds.
        high: (Da,) upper bounds.
    """

    level: str
    labels: tuple[str, ...]
    units: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray

    def __repr__(self) -> str:
        return f"ActionSpec({self.level}: {', '.join(self.labels)})"

    def __post_init__(self) -> None:
        sizes = {len(self.labels), len(self.units), len(self.low), len(self.high)}
        if len(sizes) != 1:
            raise InvalidValueError(f"ActionSpec {self.level!r}: labels, units and bounds differ in length: {sizes}.")
        if not np.all(np.asarray(self.low) < np.asarray(self.high)):
            raise InvalidValueError(f"ActionSpec {self.level!r}: every lower bound must lie below its upper bound.")

    @property
    def size(self) -> int:
        return len(self.labels)

    @property
    def reach(self) -> np.ndarray:
        """(Da,) how far each element can be from the middle of its bounds; infinite without them."""
        return 0.5 * (np.asarray(self.high, float) - np.asarray(self.low, float))

    def clip(self, action: np.ndarray) -> np.ndarray:
        """Return ``action`` (..., Da) limited to the bounds."""
        return np.clip(action, self.low, self.high)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ActionSpec) and _plain(self) == _plain(other)

    def __hash__(self) -> int:
        return hash((self.level, self.labels))


@dataclass(frozen=True)
class EnvSpec:
    """Everything a dataset or a policy must know about the environment it belongs to.

    Attributes:
        robot, task, tier: registry names.
        observation: fields of the observation.
        action: bounds, labels and units of the action.
        control_dt_s: time between two actions, in seconds.
        max_steps: steps after which an episode is truncated.
        instruction: the task in one English sentence.
        subtasks: names of the sub-task flags, in order.
        state_size: length of the full simulator state (``mjSTATE_INTEGRATION``).
        disturbances: what the tier disturbs and how strongly, as plain values; for the record.
        controller: name of the flight law under the actions, ``none`` for an environment from outside the suite.
        options: how an environment from outside is made again; empty for the suite's.
    """

    robot: str
    task: str
    tier: str
    observation: ObservationSpec
    action: ActionSpec
    control_dt_s: float
    max_steps: int
    instruction: str
    subtasks: tuple[str, ...]
    state_size: int
    disturbances: Mapping[str, Any] = field(default_factory=dict, hash=False)
    controller: str = "geometric_observer"
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __repr__(self) -> str:
        where, rate = f"{self.robot}/{self.task}, {self.tier}", 1.0 / self.control_dt_s
        return f"EnvSpec({where}, {rate:g} Hz, {self.max_steps} steps, {self.observation}, {self.action})"

    @property
    def is_outside(self) -> bool:
        """Whether the environment is not the suite's."""
        return self.controller == NO_CONTROLLER

    @property
    def is_foreign(self) -> bool:
        """Whether it was read off somebody's data, which do not say what the actions are or what was flown."""
        return self.action.level == UNKNOWN

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings, ready for JSON or YAML."""
        raw = _plain(self)
        for each in raw["observation"]["fields"]:
            _leave_out(each, onboard=False, every=1, delay=0)
        return raw if raw["options"] else {key: value for key, value in raw.items() if key != "options"}

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> EnvSpec:
        """Rebuild a specification from :meth:`to_dict`'s result."""
        try:
            fields = tuple(
                Field(**{**f, "shape": tuple(f["shape"]), "labels": tuple(f["labels"])})
                for f in raw["observation"]["fields"]
            )
            a = raw["action"]
            action = ActionSpec(
                a["level"],
                tuple(a["labels"]),
                tuple(a["units"]),
                np.asarray(a["low"], float),
                np.asarray(a["high"], float),
            )
            rest = {
                k: raw[k] for k in ("robot", "task", "tier", "control_dt_s", "max_steps", "instruction", "state_size")
            }
            return EnvSpec(
                observation=ObservationSpec(fields),
                action=action,
                subtasks=tuple(raw["subtasks"]),
                disturbances=raw.get("disturbances", {}),
                controller=raw.get("controller", "geometric_observer"),  # the only one there was
                options=raw.get("options", {}),
                **rest,
            )
        except (KeyError, TypeError) as error:
            raise InvalidValueError(f"Not an environment specification: {error!r} is missing or malformed.") from error

    def differences(self, other: EnvSpec, *, ignore: Iterable[str] = CONDITIONS) -> list[str]:
        """Name every key in which two specifications differ, as ``key: mine != theirs``; what tells most comes first.

        Of a field of the observation that one of them lacks, only the shape is named.
        """
        if self is other:  # as of all recordings of one environment
            return []
        mine, theirs = _flat(_plain(self)), _flat(_plain(other))
        others = sorted((mine.keys() | theirs.keys()) - set(FIRST_NAMED))
        lacked = set(self.observation.names) ^ set(other.observation.names)
        implied = tuple(f"observation.fields.{name}." for name in lacked)
        skip = tuple(ignore)
        return [
            f"{key}: {mine.get(key)!r} != {theirs.get(key)!r}"
            for key in (*FIRST_NAMED, *others)
            if key.split(".")[0] not in skip and mine.get(key) != theirs.get(key)
            if key.rpartition(".")[2] not in DESCRIBES
            if not key.startswith(implied) or key.endswith(".shape")
        ]


def _plain(spec: Any) -> dict[str, Any]:
    def convert(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return [float(x) for x in value]
        if isinstance(value, dict):
            return {k: convert(v) for k, v in value.items()}
        if isinstance(value, (tuple, list)):
            return [convert(v) for v in value]
        return value

    return convert(asdict(spec))


def _leave_out(raw: dict[str, Any], **defaults: Any) -> None:
    """Take out of ``raw`` what has its default, as it was before there was such a key."""
    for key, value in defaults.items():
        if raw[key] == value:
            del raw[key]


def _flat(tree: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(tree, dict):
        return {k2: v2 for k, v in tree.items() for k2, v2 in _flat(v, f"{prefix}{k}.").items()}
    if isinstance(tree, list) and tree and isinstance(tree[0], dict):
        return {k2: v2 for v in tree for k2, v2 in _flat(v, f"{prefix}{v.get('name', '')}.").items()}
    return {prefix.rstrip("."): tree}

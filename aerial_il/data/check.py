"""The gate: whatever :func:`~aerial_il.data.dataset.open_dataset` returns has passed it, in whatever format it lay.

A format renames and judges nothing. Here lengths, types, shapes and finiteness are required, the same for all; what
no file says is left empty and named as unknown; and a specification is read off demonstrations that bring none.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.core.specs import NO_CONTROLLER, UNKNOWN, ActionSpec, EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.data.source import Later, Raw, Source

log = logging.getLogger(__name__)
MARGIN = 1e-6  # of the bounds around the actions that were seen; an action that never varies has bounds, too
SERIES = ("rewards", "terminated", "truncated")
SEEN = ("states", "sim_time")  # T + 1 rows of an episode
ACTED = ("actions", "executed_actions", "expert_actions", "ctrl", "is_intervention", "phase", *SERIES)  # T rows
RECORDED = {  # attribute of an episode -> its name in a recording; finite all along
    "actions": "action", "executed_actions": "executed_action", "rewards": "reward", "states": "state",
    "ctrl": "ctrl", "sim_time": "sim_time",
}  # fmt: skip
Rows = np.ndarray | Later


def checked(source: Source) -> dict[str, Callable[[], Episode]]:
    """Return uid -> function that reads the episode, and raises :class:`DemoError` if it cannot be used.

    Raises:
        DemoError: raw demonstrations that bring no specification are not of one environment, or one cannot be used.
    """
    found: dict[str, Callable[[], Episode]] = {
        uid: partial(_recorded, source.files.get(uid), source.path, uid, read) for uid, read in source.recorded.items()
    }
    if source.raw:
        raw = source.raw if source.borders else _cut(source)
        make = partial(_episode, source, *((source.spec, False) if source.spec else _survey(source, raw)))
        found |= {uid: partial(make, uid, read) for uid, read in raw.items()}
    return found


def require_whole(gate: Gate, episode: Episode) -> None:
    """Require of a recorded episode lengths, the shapes of its specification, and numbers that are finite."""
    spec, steps = episode.spec, len(episode)
    gate.require_steps(steps)
    for names, rows in ((SEEN, steps + 1), (ACTED, steps)):
        for name in names:
            gate.require_rows(name, getattr(episode, name), rows)
    for name in ("actions", "executed_actions", "expert_actions"):
        gate.require_shape(name, getattr(episode, name), (spec.action.size,))
    for name, values in episode.obs.items():
        gate.require_rows(name, values, steps + 1)
        gate.require_shape(name, values, spec.observation[name].shape)
    for attribute, name in RECORDED.items():
        gate.require_finite(name, getattr(episode, attribute))
    for name, values in episode.obs.items():
        gate.require_finite(name, values, topic="/observation")
    absent = np.isnan(episode.expert_actions)
    half = np.asarray((absent.any(1) & ~absent.all(1)) | np.isinf(episode.expert_actions).any(1))  # whole or absent
    gate.require_finite("expert_action", np.where(half[:, None], episode.expert_actions, 0.0))


def episode_of(uid: str, raw: Raw, spec: EnvSpec, *, note: str, success: bool = True) -> Episode:
    """Return the episode of a raw demonstration, which the gate has let pass.

    Args:
        uid: its name. spec: of its environment. note: for its provenance. success: where the demonstration says none.
    """
    steps, actions = len(raw.actions), raw.actions.astype(float)
    none, last = np.zeros(steps, bool), np.arange(steps) == steps - 1
    rewards, terminated, truncated = (_series(getattr(raw, name), steps) for name in SERIES)
    return Episode(
        uid=uid,
        spec=spec,
        provenance={**raw.provenance, "note": note},
        obs={field.name: _observed(raw, field) for field in spec.observation.fields if field.name in raw.obs},
        actions=actions,
        executed_actions=actions,
        expert_actions=np.full_like(actions, np.nan),
        is_intervention=none,
        phase=np.full(steps, -1),
        rewards=rewards,
        terminated=last & bool(terminated[-1]),
        truncated=last & bool(truncated[-1] and not terminated[-1]),
        states=np.zeros((steps + 1, 0)) if raw.states is None else _ended(raw.states, steps),
        ctrl=np.zeros((steps, 0)),
        sim_time=np.arange(steps + 1) * spec.control_dt_s,
        success=success if raw.success is None else raw.success,
        model_xml=raw.model_xml,
    )


class Gate:
    """Refuses what cannot be used, by an error that names the file, the episode, the field and the step.

    Args:
        path: the file or folder. uid: the episode, where the file holds several.
    """

    def __init__(self, path: Path | str, uid: str = "") -> None:
        self.path, self.uid = path, uid

    def refuse(self, problem: str, **where: Any) -> NoReturn:
        raise DemoError(self.path, f"{self.uid} {problem}".strip(), **where)

    def require_steps(self, steps: int) -> None:
        if not steps:
            self.refuse("has no steps.")

    def require_rows(self, name: str, values: Rows, *rows: int) -> None:
        """Require rows of numbers, as many as one of ``rows``."""
        if values.dtype.kind not in "biuf" or not values.shape:
            self.refuse(f"has {name} that are not rows of numbers.", got=(values.dtype, values.shape))
        if values.shape[0] not in rows:
            wanted = f"{' or '.join(map(str, rows))} rows"
            self.refuse(f"has {name} of another length than its actions.", expected=wanted, got=values.shape[0])

    def require_shape(self, name: str, values: Rows, shape: tuple[int, ...]) -> None:
        """Require what a row is like."""
        if (got := values.shape[1:]) != shape:
            self.refuse(f"has {name} of another shape than others or its specification.", expected=shape, got=got)

    def require_finite(self, name: str, values: np.ndarray, *, topic: str = "/step") -> None:
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            step, *rest = np.argwhere(~np.isfinite(values))[0].tolist()
            field, at = name + "".join(f"[{i}]" for i in rest), {} if self.uid else {"topic": topic}
            self.refuse("has a value that is not finite.", step=step, field=field, got=values[(step, *rest)], **at)

    def require_usable(self, raw: Raw) -> None:
        """Require that a raw demonstration can be learned from; arrays that are read later are not read."""
        if raw.actions.ndim != 2 or raw.actions.dtype.kind != "f":
            hint = "Actions of a Discrete or Tuple space cannot be imitated here."
            got = (raw.actions.dtype, raw.actions.shape)
            self.refuse("has actions that are not vectors of numbers.", got=got, hint=hint)
        steps = len(raw.actions)
        self.require_steps(steps)
        further = {name: values for name in SERIES if (values := getattr(raw, name)) is not None}
        for name, values in further.items():
            self.require_rows(name, values, steps)
            if values.size != steps:
                self.refuse(f"has {name} that are not one number a step.", got=values.shape)
        for name, values in {**raw.obs, **({} if raw.states is None else {"states": raw.states})}.items():
            self.require_rows(name, values, steps, steps + 1)
        for name, values in (raw.next_obs or {}).items():
            self.require_rows(f"next {name}", values, steps)
        for name, values in {"actions": raw.actions, **further, **raw.obs, **(raw.next_obs or {})}.items():
            if not isinstance(values, Later):
                self.require_finite(name, values)


def _recorded(file: Path | None, path: Path, uid: str, read: Callable[[], Episode]) -> Episode:
    episode = read()
    require_whole(Gate(path, uid) if file is None else Gate(file), episode)
    return episode


def _episode(source: Source, spec: EnvSpec, judged: bool, uid: str, read: Callable[[], Raw]) -> Episode:
    """Return an episode of ``spec``; ``judged``: whether any of the dataset is marked as a success or a failure."""
    raw, gate = read(), Gate(source.path, uid)
    gate.require_usable(raw)
    gate.require_shape("actions", raw.actions, (spec.action.size,))
    if source.spec and (odd := sorted(raw.obs.keys() - {*spec.observation.names})):
        gate.refuse(f"has {', '.join(odd)}, which its specification lacks.", expected=spec.observation.names)
    for field in spec.observation.fields:
        if field.name in raw.obs:
            gate.require_shape(field.name, _flat(raw.obs[field.name]), field.shape)
        elif field.group != "image":
            gate.refuse(f"lacks {field.name}.", got=sorted(raw.obs))
    episode = episode_of(uid, raw, spec, note=f"read from {source.path.name}, {source.kind}", success=not judged)
    for name in raw.obs.keys() & episode.obs.keys():
        gate.require_finite(name, episode.obs[name])
    return episode


def _survey(source: Source, raw: Mapping[str, Callable[[], Raw]]) -> tuple[EnvSpec, bool]:
    """Return the specification that all demonstrations have in common, and whether any is judged."""
    fields: dict[str, Rows] = {}
    lows, highs, longest, states, judged = [], [], 0, 0, False
    for number, (uid, read) in enumerate(raw.items()):
        each, gate = read(), Gate(source.path, uid)
        gate.require_usable(each)
        obs = {name: _flat(values) for name, values in each.obs.items()}
        if number == 0:
            fields, states = obs, 0 if each.states is None else each.states.shape[1]
        for name in fields.keys() & obs.keys():
            gate.require_shape(name, obs[name], fields[name].shape[1:])
        if odd := sorted(fields.keys() ^ obs.keys()):
            log.warning("%s: %s is not in all demonstrations, and left out.", source.path, ", ".join(odd))
            fields = {name: fields[name] for name in fields if name in obs}
        gate.require_shape("actions", each.actions, each.actions.shape[1:] if not lows else lows[0].shape)
        lows.append(each.actions.min(0))
        highs.append(each.actions.max(0))
        longest, judged = max(longest, len(each.actions)), judged or each.success is not None
    low, high = np.min(lows, 0).astype(float), np.max(highs, 0).astype(float)
    labels = tuple(f"a{i}" for i in range(len(low)))
    spec = EnvSpec(
        robot=source.robot,
        task=source.task,
        tier=UNKNOWN,
        observation=ObservationSpec(tuple(_field(name, values) for name, values in fields.items())),
        action=ActionSpec(UNKNOWN, labels, ("",) * len(labels), low - MARGIN, high + MARGIN),
        control_dt_s=source.control_dt_s,
        max_steps=longest,
        instruction="",
        subtasks=(),
        state_size=states,
        controller=NO_CONTROLLER,
    )
    return spec, judged


def _cut(source: Source) -> dict[str, Callable[[], Raw]]:
    """Cut transitions one after the other where an episode ended, or time was up."""
    ((uid, read),) = source.raw.items()
    whole, ends = read(), [0]
    gate, steps = Gate(source.path, uid), len(whole.actions)
    gate.require_usable(whole)
    for name, values in whole.obs.items():
        gate.require_rows(name, values, steps)
    over = _series(whole.terminated, steps).astype(bool) | _series(whole.truncated, steps).astype(bool)
    ends += [*(np.flatnonzero(over[:-1]) + 1).tolist(), steps]

    def part(first: int, last: int) -> Raw:
        told: dict[str, Any] = {name: getattr(whole, name) for name in SERIES}
        obs = {name: np.asarray(values)[first:last] for name, values in whole.obs.items()}
        for name, after in (whole.next_obs or {}).items():
            obs[name] = np.concatenate([obs[name], after[last - 1 : last]])
        told = {name: None if values is None else values[first:last] for name, values in told.items()}
        return Raw(obs=obs, actions=whole.actions[first:last], **told)

    return {f"{uid}_{i:06d}": partial(part, *ends[i : i + 2]) for i in range(len(ends) - 1)}


def _field(name: str, values: Rows) -> Field:
    pictured = values.dtype == np.uint8 and len(values.shape) == 4
    group, dtype = ("image", "uint8") if pictured else ("proprio", "float64")
    return Field(name, values.shape[1:], group, dtype)


def _flat(values: Rows) -> Rows:
    """Return (T,) numbers as (T, 1)."""
    if len(values.shape) > 1 or isinstance(values, Later):
        return values
    return values[:, None]


def _observed(raw: Raw, field: Field) -> np.ndarray:
    """Return (T + 1, ...) values; the last one stands in for the terminal one where that was not kept."""
    values = raw.obs[field.name]
    values = values.read() if isinstance(values, Later) else values
    return _ended(values.reshape(-1, *field.shape).astype(field.dtype, copy=False), len(raw.actions))


def _ended(values: np.ndarray, steps: int) -> np.ndarray:
    return values if len(values) > steps else np.concatenate([values, values[-1:]])


def _series(values: np.ndarray | None, steps: int) -> np.ndarray:
    """Return (T,) numbers, zero where there are none."""
    return np.zeros(steps) if values is None else values.reshape(steps).astype(float)

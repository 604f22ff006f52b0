"""A demonstration as its file holds it, read and made an episode; what it lacks is left empty.

An end of which the format does not say what it means, and success, are what was asked for, or what the format means.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data.borders import ordered
from aerial_il.data.check import SERIES, Gate, require_whole
from aerial_il.data.episode import Episode
from aerial_il.data.pictures import Kind
from aerial_il.data.source import Later, Raw, Rows, Wanted


@dataclass(frozen=True)
class Agreed:
    """What the episodes of a dataset have in common.

    Attributes:
        spec: their environment. kinds: field -> what it holds.
        period_s: between two time stamps, if known. judged: whether any is marked as a success or a failure.
        declared: whether the dataset says its specification, so that nothing else may be in it.
    """

    spec: EnvSpec
    kinds: Mapping[str, Kind]
    period_s: float | None
    judged: bool
    declared: bool = False


def last_alone(steps: int) -> np.ndarray:
    """(T,) bool, true at the last step."""
    return np.arange(steps) == steps - 1


def episode_of(uid: str, raw: Raw, spec: EnvSpec, *, note: str, success: bool = True) -> Episode:
    """Return the episode of a raw demonstration, which the gate has let pass.

    Args:
        uid: its name. spec: of its environment. note: for its provenance. success: where the demonstration says none.
    """
    steps, actions = len(raw.actions), np.asarray(raw.actions, float)
    none, last = np.zeros(steps, bool), last_alone(steps)
    over, late = (flags is not None and bool(np.ravel(flags)[-1]) for flags in (raw.terminated, raw.truncated))
    return Episode(
        uid=uid,
        spec=spec,
        provenance={**raw.provenance, "note": note},
        obs={name: np.asarray(values) for name, values in raw.obs.items()},
        actions=actions,
        executed_actions=actions,
        expert_actions=np.full_like(actions, np.nan),
        is_intervention=none,
        phase=np.full(steps, -1),
        rewards=np.zeros(steps) if raw.rewards is None else np.reshape(raw.rewards, steps).astype(float),
        terminated=last & over,
        truncated=last & (late and not over),
        states=np.zeros((steps + 1, 0)) if raw.states is None else _ended(np.asarray(raw.states), steps),
        ctrl=np.zeros((steps, 0)),
        sim_time=np.arange(steps + 1) * spec.control_dt_s,
        success=success if raw.success is None else raw.success,
        model_xml=raw.model_xml,
    )


def taken(gate: Gate, raw: Raw, wanted: Wanted) -> tuple[Raw, int | None]:
    """Return a demonstration in order, its numbers read and its pictures not, and the first row out of place if any."""
    gate.require_aligned(raw)
    held = {name: values for name in ("actions", "states", *SERIES) if (values := getattr(raw, name)) is not None}
    if not wanted.states:
        held.pop("states", None)
    numbers = {name: values for name, values in raw.obs.items() if not _pictured(values)}
    after = {name: values for name, values in raw.next_obs.items() if not _pictured(values)}
    seen = [values for name, values in raw.obs.items() if name not in numbers and wanted.sees(name)]
    gate.require_memory([*held.values(), *numbers.values(), *after.values(), *seen], wanted.memory_mb)
    read = {name: _read(gate, name, values) for name, values in held.items()}
    read["actions"] = np.reshape(read["actions"], (len(raw.actions), -1))
    obs = {**raw.obs, **{name: _read(gate, name, values) for name, values in numbers.items()}}
    next_obs = {**raw.next_obs, **{name: _read(gate, f"next {name}", values) for name, values in after.items()}}
    return ordered(replace(raw, **{"states": None, **read, "obs": obs, "next_obs": next_obs}))


def episode(gate: Gate, raw: Raw, wanted: Wanted, agreed: Agreed, *, note: str) -> Episode:
    """Return a demonstration that was :func:`taken` as an episode of what was agreed on.

    Raises:
        DemoError: it cannot be used, or is not of it.
    """
    spec = agreed.spec
    gate.require_usable(raw, agreed.period_s)
    gate.require_shape("actions", np.asarray(raw.actions), (spec.action.size,))
    if agreed.declared and (odd := sorted(raw.obs.keys() - {*spec.observation.names})):
        gate.refuse(f"has {', '.join(odd)}, which its specification lacks.", expected=spec.observation.names)
    if missing := [n for n, kind in agreed.kinds.items() if kind.group != "image" and n not in raw.obs]:
        gate.refuse(f"lacks {', '.join(missing)}.", got=sorted(raw.obs))
    kinds = {n: k for n, k in agreed.kinds.items() if n in raw.obs and (k.group != "image" or wanted.sees(n))}
    obs = {name: _observed(gate, raw, name, kind) for name, kind in kinds.items()}
    raw = replace(raw if agreed.declared else _answered(raw, wanted), obs=obs)
    raw = replace(raw, states=raw.states if spec.state_size else None)
    made = episode_of(gate.uid, raw, spec, note=note, success=not agreed.judged)
    require_whole(gate, made)
    return made


def _pictured(values: Rows) -> bool:
    return Kind.of(values).group == "image"


def _read(gate: Gate, name: str, values: Rows) -> np.ndarray:
    """Return an array that may have to be read, which must be what was promised."""
    if not isinstance(values, Later):
        return values
    read = values.read()
    if read.shape != values.shape:
        gate.refuse(f"has other {name} than it says.", expected=values.shape, got=read.shape)
    return read


def _observed(gate: Gate, raw: Raw, name: str, kind: Kind) -> np.ndarray:
    """Return (T + 1, ...) values; the last one stands in for the terminal one where that was not kept."""
    steps, values = len(raw.actions), _read(gate, name, raw.obs[name])
    if len(values) == steps:
        after = raw.next_obs.get(name)
        values = np.concatenate([values, values[-1:] if after is None else _read(gate, f"next {name}", after[-1:])])
    if kind.shape not in (values.shape[1:], Kind.of(values).shape):
        gate.require_shape(name, values, kind.shape)
    gate.require_finite(name, values)
    try:
        return kind.held(values)
    except ValueError as error:
        gate.refuse(f"has {name} that are no pictures: {error}.")


def _answered(raw: Raw, wanted: Wanted) -> Raw:
    """Return a demonstration with its end and its success as they were asked for, or as its format means them."""
    over, done = (flags is not None and bool(np.ravel(flags)[-1]) for flags in (raw.terminated, raw.done))
    unsaid = raw.terminated is raw.truncated is raw.done is None
    success, rewards = raw.success, np.zeros(1) if raw.rewards is None else np.ravel(raw.rewards).astype(float)
    over = (
        over or (done and bool(success)) if wanted.terminals is None else wanted.terminals and (over or done or unsaid)
    )
    if wanted.least_return is not None:
        success = bool(rewards.sum() >= wanted.least_return)
    elif wanted.success is not None:
        success = {"all": True, "reward": bool(rewards[-1] > 0), "terminal": over, "survived": not over}[wanted.success]
    return replace(raw, terminated=last_alone(len(raw.actions)) & over, success=success)


def _ended(values: np.ndarray, steps: int) -> np.ndarray:
    return values if len(values) > steps else np.concatenate([values, values[-1:]])

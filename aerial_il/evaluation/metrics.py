"""Metrics of one episode, and their summary with spread over many."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from aerial_il.core.composition import fits
from aerial_il.core.schema import hints_of
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import EnvSpec
from aerial_il.evaluation.statistics import bootstrap_mean, wilson
from aerial_il.evaluation.traces import Trace

End = Literal["success", "crash", "dropped", "timeout"]
ENDS: tuple[End, ...] = ("success", "crash", "dropped", "timeout")
FAST_HZ = 5.0  # above which changes of an action are no manoeuvre but shaking
LEAST_STEPS = 16  # of an episode whose spectrum can be computed


@dataclass(frozen=True)
class EpisodeRecord:
    """The numbers of one episode; None where a number does not exist, such as the time to a success never reached.

    Attributes:
        seed: seed of the episode.
        end: why it ended: first success, crash, an object lost for good, or the time limit.
        steps: control steps flown.
        duration_s: simulated time flown.
        time_to_success_s: simulated time to the first success.
        return_: sum of the rewards.
        mean_reward: mean of the rewards, in [0, 1] in this suite.
        ee_error_mean_m, ee_error_max_m: distance between commanded and actual end effector over the steps; policies
            that command far-away targets fly with a large one.
        effort_mean: mean squared rotor use in [0, 1].
        action_jerk_rms: unit -> root mean square of the executed action's third derivative, e.g. ``m/s^3``.
        contact_events: times that the robot's body, rotors or arm came to touch the world.
        contact_time_s: time for which they touched it.
        subtasks: sub-task -> time at which it was first done, None if never.
        force_in_band_raw: share of the time in contact, up to the end, in which the force before the sensor's filter
            was as the task asks.
        action_rate_rms: unit -> root mean square of the executed action's first derivative, e.g. ``m/s``.
        action_fast_share: share of the executed action's changes that lies above ``FAST_HZ``, by their power; None for
            short episodes, and where actions follow each other too slowly.
    """

    seed: int
    end: End
    steps: int
    duration_s: float
    time_to_success_s: float | None
    return_: float
    mean_reward: float
    ee_error_mean_m: float | None
    ee_error_max_m: float | None
    effort_mean: float | None
    action_jerk_rms: Mapping[str, float]
    contact_events: int
    contact_time_s: float
    subtasks: Mapping[str, float | None]
    force_in_band_raw: float | None = None
    action_rate_rms: Mapping[str, float] = field(default_factory=dict)
    action_fast_share: float | None = None

    @property
    def success(self) -> bool:
        return self.end == "success"

    def to_dict(self) -> dict[str, Any]:
        raw = asdict(self)
        raw["return"] = raw.pop("return_")
        return {"seed": raw.pop("seed"), "success": self.success, **raw}

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> EpisodeRecord:
        """Return the record that :meth:`to_dict` wrote.

        Raises:
            KeyError, TypeError: it lacks something, or says something else than such a record does.
        """
        rest = {key: value for key, value in raw.items() if key not in ("return", "success")}
        if type(raw["seed"]) is not int or raw["end"] not in ENDS:
            raise TypeError(f"episode {raw['seed']!r} that ended as {raw['end']!r}")
        if not all(isinstance(raw[name], int | float) and math.isfinite(raw[name]) for name in ("return", "steps")):
            raise TypeError(f"return {raw['return']!r} and steps {raw['steps']!r} of episode {raw['seed']}")
        record, hints = EpisodeRecord(return_=raw["return"], **rest), hints_of(EpisodeRecord)
        for name, value in vars(record).items():
            if not fits(value, hints[name]):
                raise TypeError(f"{name} {value!r} of episode {raw['seed']}")
        return record


@dataclass(frozen=True)
class Metric:
    """A number that every episode has or lacks.

    Attributes:
        key: name in ``evaluation.json``.
        label: name for people.
        unit: SI unit, empty if dimensionless.
        value: reads it from a record.
        better: which way is good.
    """

    key: str
    label: str
    unit: str
    value: Callable[[EpisodeRecord], float | None]
    better: Literal["higher", "lower"]


RETURN = Metric("return", "Return", "", lambda e: e.return_, "higher")
METRICS = (
    Metric("time_to_success_s", "Time to success", "s", lambda e: e.time_to_success_s, "lower"),
    Metric("mean_reward", "Mean reward", "", lambda e: e.mean_reward, "higher"),
    Metric("steps", "Control steps", "", lambda e: e.steps, "lower"),
    Metric("ee_error_mean_m", "End-effector tracking error, mean", "m", lambda e: e.ee_error_mean_m, "lower"),
    Metric("ee_error_max_m", "End-effector tracking error, largest", "m", lambda e: e.ee_error_max_m, "lower"),
    Metric("effort_mean", "Control effort, squared rotor use", "", lambda e: e.effort_mean, "lower"),
    Metric("action_fast_share", f"Action changes above {FAST_HZ:g} Hz", "", lambda e: e.action_fast_share, "lower"),
    Metric("contact_events", "Unwanted contacts", "", lambda e: e.contact_events, "lower"),
    Metric("contact_time_s", "Time in unwanted contact", "s", lambda e: e.contact_time_s, "lower"),
    Metric("force_in_band_raw", "Time with the unfiltered force as asked", "", lambda e: e.force_in_band_raw, "higher"),
)


def metrics_of(episodes: Sequence[EpisodeRecord]) -> tuple[Metric, ...]:
    """Return every metric that these episodes have: the common ones, a jerk and a rate per unit of the action."""
    jerks = dict.fromkeys(unit for episode in episodes for unit in episode.action_jerk_rms)
    rates = dict.fromkeys(unit for episode in episodes for unit in episode.action_rate_rms)
    return (
        RETURN,
        *METRICS,
        *(_of_action("jerk", unit) for unit in jerks),
        *(_of_action("rate", unit) for unit in rates),
    )


def _of_action(kind: Literal["jerk", "rate"], unit: str) -> Metric:
    field_name, raised = f"action_{kind}_rms", unit.replace("^2", "²").replace("^3", "³").replace("^4", "⁴")
    label = f"Action {kind} ({raised})"
    return Metric(f"{field_name}[{unit}]", label, unit, lambda e: getattr(e, field_name).get(unit), "lower")


def measure(trace: Trace, spec: EnvSpec) -> EpisodeRecord:
    """Reduce one flown episode to its numbers."""
    dt, steps = spec.control_dt_s, len(trace)
    touching = trace.contacts > 0
    onsets = int(touching[0]) + int(np.count_nonzero(touching[1:] & ~touching[:-1]))
    error = trace.ee_error_m[np.isfinite(trace.ee_error_m)]
    return EpisodeRecord(
        seed=trace.seed,
        end=why_ended(success=trace.success, crash=trace.crash, dropped=trace.dropped),
        steps=steps,
        duration_s=_tidy(steps * dt),
        time_to_success_s=(_first_time(trace.solved, dt) or _tidy(steps * dt)) if trace.success else None,
        return_=float(trace.reward.sum()),
        mean_reward=float(trace.reward.mean()),
        ee_error_mean_m=float(error.mean()) if error.size else None,
        ee_error_max_m=float(error.max()) if error.size else None,
        effort_mean=float(trace.effort.mean()) if np.isfinite(trace.effort).all() else None,
        action_jerk_rms=derivative_rms(trace.executed, spec.action.units, dt, order=3),
        action_rate_rms=derivative_rms(trace.executed, spec.action.units, dt, order=1),
        action_fast_share=action_fast_share(spec.action.low, spec.action.high, trace.executed, dt),
        contact_events=onsets,
        contact_time_s=_tidy(np.count_nonzero(touching) * dt),
        subtasks={name: _first_time(trace.subtasks[:, k], dt) for k, name in enumerate(spec.subtasks)},
        force_in_band_raw=_last_known(trace.force_in_band_raw),
    )


def why_ended(*, success: bool, crash: bool, dropped: bool) -> End:
    """Return why an episode ended; what is none of these ran out of time."""
    return "success" if success else "crash" if crash else "dropped" if dropped else "timeout"


def derivative_rms(actions: np.ndarray, units: Sequence[str], dt_s: float, *, order: int) -> dict[str, float]:
    """Return the root mean square of a derivative of an action sequence, one number per unit.

    Args:
        actions: (T, Da) executed actions.
        units: Da units; elements that share one are averaged together.
        dt_s: time between two actions.
        order: of the derivative; 3 for jerk, 1 for rate.

    Returns:
        E.g. ``unit/s^3`` -> value, by finite differences; empty for ``order`` steps or fewer.
    """
    if len(actions) <= order:
        return {}
    squared = (np.diff(actions, n=order, axis=0) / dt_s**order) ** 2
    of_unit = {unit: [k for k, other in enumerate(units) if other == unit] for unit in units}
    return {_per_s(unit, order): float(np.sqrt(squared[:, columns].mean())) for unit, columns in of_unit.items()}


def action_fast_share(low: np.ndarray, high: np.ndarray, actions: np.ndarray, dt_s: float) -> float | None:
    """Return the share of an action's changes from step to step that lies above ``FAST_HZ``, by their power.

    Args:
        low, high: (Da,) bounds, by which elements of different units are made comparable; unbounded ones are left out.
        actions: (T, Da) executed. dt_s: time between two of them.
    """
    bounded = np.isfinite(high - low)
    if len(actions) < LEAST_STEPS or not bounded.any() or 0.5 / dt_s <= FAST_HZ:
        return None
    changes = np.diff(actions[:, bounded] / (high - low)[bounded], axis=0)
    power = (np.abs(np.fft.rfft(changes, axis=0)) ** 2).sum(axis=1)
    fast = np.fft.rfftfreq(len(changes), dt_s) > FAST_HZ
    return float(power[fast].sum() / power.sum()) if power.sum() > 0 else 0.0


def aggregate(episodes: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Return the ``metrics`` of ``evaluation.json``: each number with its spread, each rate with its interval."""
    numbers = {m.key: spread(m.key, map(m.value, episodes)) for m in metrics_of(episodes) if m is not RETURN}
    return {
        **numbers,
        "crash": proportion([e.end == "crash" for e in episodes]),
        "dropped": proportion([e.end == "dropped" for e in episodes]),
        "contact": proportion([e.contact_events > 0 for e in episodes]),
        "ends": {end: sum(e.end == end for e in episodes) for end in ENDS},
        "subtasks": {name: _subtask(name, episodes) for name in (episodes[0].subtasks if episodes else ())},
    }


def spread(key: str, values: Iterable[float | None]) -> dict[str, Any]:
    """Return count, mean with bootstrap interval, standard deviation, median and range of the values that exist.

    Args:
        key: names the random stream of the bootstrap, so that equal values give an equal interval.
        values: one number per episode, None where there is none.
    """
    known = np.array([value for value in values if value is not None], dtype=float)
    if known.size == 0:
        return {"count": 0} | dict.fromkeys(("mean", "ci95", "std", "median", "min", "max"))
    return {
        "count": known.size,
        "mean": float(known.mean()),
        "ci95": list(bootstrap_mean(known, rng=named_rng(0, "evaluation", "bootstrap", key))),
        "std": float(known.std(ddof=1)) if known.size > 1 else 0.0,
        "median": float(np.median(known)),
        "min": float(known.min()),
        "max": float(known.max()),
    }


def proportion(outcomes: Sequence[bool]) -> dict[str, Any]:
    """Return count, rate and Wilson interval of the true ones; rate and interval are None without any outcome."""
    count, total = sum(outcomes), len(outcomes)
    if total == 0:
        return {"count": 0, "rate": None, "ci95": None}
    return {"count": count, "rate": count / total, "ci95": list(wilson(count, total))}


def _subtask(name: str, episodes: Sequence[EpisodeRecord]) -> dict[str, Any]:
    times = [episode.subtasks[name] for episode in episodes]
    return {**proportion([time is not None for time in times]), "time_s": spread(f"subtask/{name}", times)}


def _first_time(flags: np.ndarray, dt_s: float) -> float | None:
    return _tidy((int(np.argmax(flags)) + 1) * dt_s) if flags.any() else None


def _last_known(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known[-1]) if known.size else None


def _per_s(unit: str, order: int) -> str:
    """Return the unit of the derivative of that order: ``m`` -> ``m/s^3``, ``m/s`` -> ``m/s^4``."""
    order += unit.endswith("/s")
    return f"{unit.removesuffix('/s') or '1'}/s" + (f"^{order}" if order > 1 else "")


def _tidy(time_s: float) -> float:
    """Drop the binary dust of ``steps * dt``."""
    return round(float(time_s), 9)

"""The gate: what is required of every episode, in whatever format it lay.

A format renames and judges nothing. Here lengths, types, shapes, finiteness, bounds, time stamps and ends are required,
the same for all; whatever is refused is a :class:`DemoError` that names the episode, the field and the step.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.data.borders import off_rate
from aerial_il.data.episode import Episode
from aerial_il.data.source import MEGABYTE, Later, Raw, Rows

SERIES = ("rewards", "terminated", "truncated", "done", "frames", "times")
SEEN = ("states", "sim_time")  # T + 1 rows of an episode
ACTED = (  # T rows
    "actions", "executed_actions", "expert_actions", "ctrl", "is_intervention", "phase", "rewards", "terminated",
    "truncated",
)  # fmt: skip
RECORDED = {  # attribute of an episode -> its name in a recording; finite all along
    "actions": "action", "executed_actions": "executed_action", "rewards": "reward", "states": "state",
    "ctrl": "ctrl", "sim_time": "sim_time",
}  # fmt: skip
STEP = {"topic": "/step"}  # of a recording, whose errors name it
TIME_TOLERANCE_S, BOUND_TOLERANCE = 1e-6, 1e-9
HALF = 0.5  # of a control period, by which a time stamp may be early or late


class Gate:
    """Refuses what cannot be used, by an error that names the file, the episode, the field and the step.

    Args:
        path: the file or folder. uid: the episode, where the file holds several.
    """

    def __init__(self, path: Path | str, uid: str = "") -> None:
        self.path, self.uid = path, uid

    def refuse(self, problem: str, *, topic: str | None = None, **where: Any) -> NoReturn:
        raise DemoError(self.path, f"{self.uid} {problem}".strip(), topic=None if self.uid else topic, **where)

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
            field = name + "".join(f"[{i}]" for i in rest)
            got = values[(step, *rest)]
            self.refuse("has a value that is not finite.", topic=topic, step=step, field=field, got=got)

    def require_memory(self, arrays: Iterable[Rows], limit_mb: int) -> None:
        """Require that arrays can be held together, before one of them is read: numbers as 64 bits each."""
        sizes = [each.nbytes if len(each.shape) > 3 else 8 * each.nbytes // each.dtype.itemsize for each in arrays]
        if (size := sum(sizes)) > limit_mb * MEGABYTE:
            hint = "Allow for more with memory_mb=N (dataset.memory_mb=N where it is trained on)."
            self.refuse(
                "takes too much memory.", expected=f"at most {limit_mb} MB", got=f"{size / MEGABYTE:.0f} MB", hint=hint
            )

    def require_aligned(self, raw: Raw) -> None:
        """Require actions that are vectors, and as many rows of all else; values are not looked at."""
        if len(raw.actions.shape) not in (1, 2) or raw.actions.dtype.kind != "f":
            hint = "Actions of a Discrete or Tuple space cannot be imitated here."
            got = (raw.actions.dtype, raw.actions.shape)
            self.refuse("has actions that are not vectors of numbers.", got=got, hint=hint)
        steps = len(raw.actions)
        self.require_steps(steps)
        if raw.steps not in (None, steps):
            self.refuse("has another number of actions than its file says.", expected=raw.steps, got=steps)
        if not raw.obs:
            self.refuse("has no observations.")
        for name in SERIES:
            if (values := getattr(raw, name)) is not None:
                self.require_rows(name, values, steps)
                if np.prod(values.shape) != steps:
                    self.refuse(f"has {name} that are not one number a step.", got=values.shape)
        for name, values in {**raw.obs, **({} if raw.states is None else {"states": raw.states})}.items():
            self.require_rows(name, values, steps, steps + 1)
        for name, values in raw.next_obs.items():
            self.require_rows(f"next {name}", values, steps)
            if name in raw.obs and values.shape[1:] != raw.obs[name].shape[1:]:
                self.refuse(
                    f"has next {name} of another shape.", expected=raw.obs[name].shape[1:], got=values.shape[1:]
                )

    def require_usable(self, raw: Raw, period_s: float | None) -> None:
        """Require that an aligned demonstration can be learned from; arrays that are read later are not read."""
        series = {name: values for name in SERIES if (values := getattr(raw, name)) is not None}
        numbers = {"actions": raw.actions, **series, **raw.obs, **{f"next {n}": v for n, v in raw.next_obs.items()}}
        for name, values in numbers.items():
            if not isinstance(values, Later):
                self.require_finite(name, values)
        for name in ("terminated", "truncated"):
            if name in series:
                self._require_end(name, np.asarray(series[name]).reshape(-1) != 0)
        if raw.frames is not None and (doubled := np.flatnonzero(np.diff(np.asarray(raw.frames)) == 0)).size:
            self.refuse("has two rows of one number.", step=int(doubled[0]) + 1, field="frame_index")
        if raw.times is not None and period_s:
            self._require_rate(np.asarray(raw.times, float).reshape(-1), period_s)

    def require_flight(self, episode: Episode) -> None:
        """Require that actions are within bounds, time advances evenly, and the end comes last."""
        action, dt = episode.spec.action, episode.spec.control_dt_s
        slack = BOUND_TOLERANCE * (action.high - action.low)
        outside = (episode.actions < action.low - slack) | (episode.actions > action.high + slack)
        if outside.any():
            step, i = np.argwhere(outside)[0].tolist()
            self.refuse(
                "has an action outside its bounds.", **STEP, step=step, field=f"action.{action.labels[i]}",
                expected=f"{action.low[i]}..{action.high[i]}", got=episode.actions[step, i],
            )  # fmt: skip
        late = ~(np.abs(np.diff(episode.sim_time) - dt) <= TIME_TOLERANCE_S)
        if late.any() or episode.sim_time[0] < 0:
            step = int(np.argmax(late)) + 1
            self.refuse(
                "has time stamps that do not advance evenly.", **STEP, step=step, field="sim_time",
                expected=f"steps of {dt} s", got=episode.sim_time[step - 1 : step + 1],
            )  # fmt: skip
        for name in ("terminated", "truncated"):
            self._require_end(name, getattr(episode, name))
        if episode.terminated[-1] and episode.success and not episode.spec.is_outside:  # others may end by being solved
            at = {**STEP, "step": len(episode) - 1, "field": "terminated"}
            self.refuse("claims success although it ended in a crash.", **at)

    def _require_end(self, name: str, flags: np.ndarray) -> None:
        if (early := np.flatnonzero(flags[:-1])).size:
            self.refuse(f"goes on after it was {name}.", **STEP, step=int(early[0]), field=name)

    def _require_rate(self, times: np.ndarray, period_s: float) -> None:
        """Require time stamps that advance by a control period, give or take half of one."""
        if other := off_rate(times, period_s):
            hint = f"If the time stamps are right: control_dt={other:.6g}."
            self.refuse("has time stamps of another rate.", expected=f"steps of {period_s:.6g} s", got=other, hint=hint)
        passed = np.diff(times)
        if (wrong := np.abs(passed - period_s) > HALF * period_s).any():
            step = int(np.argmax(wrong)) + 1
            self.refuse(
                "has time stamps that do not advance evenly.", step=step, field="times",
                expected=f"steps of {period_s:.6g} s", got=times[step - 1 : step + 1],
            )  # fmt: skip


def require_whole(gate: Gate, episode: Episode) -> None:
    """Require of an episode lengths, the shapes of its specification, numbers that are finite, and a flight."""
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
    gate.require_flight(episode)

"""Traces of episodes, step by step, kept for n worlds at once until each episode ends."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aerial_il.core.specs import EnvSpec

NO_PHASE = -1


@dataclass(frozen=True, eq=False)
class Trace:
    """One finished episode of T steps.

    Attributes:
        seed: seed of the episode.
        success: the task's success held at the last step.
        crash: the environment terminated the episode for a crash. dropped: or because an object is lost for good.
        reward: (T,) in [0, 1] in this suite.
        ee_error_m: (T,) distance between commanded and actual end effector; NaN where none is commanded.
        effort: (T,) mean squared rotor use in [0, 1].
        contacts: (T,) number of unwanted contacts.
        subtasks: (T, K) sub-task flags.
        actions: (T, Da) as the policy commanded them.
        executed: (T, Da) as the environment executed them.
        ee_pos: (T, 3) end effector in the world after each step, m; NaN where it is not observed.
        phase: (T,) phase of a scripted policy, -1 for policies without phases.
        solved: (T,) bool, the task's success after each step; empty where it was not kept.
        force_in_band_raw: (T,) share of the time in contact with the unfiltered force as asked; NaN where none is.
    """

    seed: int
    success: bool
    crash: bool
    reward: np.ndarray
    ee_error_m: np.ndarray
    effort: np.ndarray
    contacts: np.ndarray
    subtasks: np.ndarray
    actions: np.ndarray
    executed: np.ndarray
    ee_pos: np.ndarray
    phase: np.ndarray
    dropped: bool = False
    solved: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    force_in_band_raw: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.reward)


class TraceBuffer:
    """Arrays (max_steps, n, ...) that fill as n worlds fly; cutting a world's column out gives its :class:`Trace`.

    Attributes:
        steps: (n,) control steps taken in the current episode of each world.
    """

    def __init__(self, spec: EnvSpec, num_envs: int) -> None:
        shape, action = (spec.max_steps, num_envs), (spec.action.size,)
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self._columns = {
            "reward": np.zeros(shape),
            "ee_error_m": np.zeros(shape),
            "effort": np.zeros(shape),
            "contacts": np.zeros(shape, dtype=np.int32),
            "subtasks": np.zeros((*shape, len(spec.subtasks)), dtype=bool),
            "actions": np.zeros(shape + action),
            "executed": np.zeros(shape + action),
            "ee_pos": np.full((*shape, 3), np.nan),
            "phase": np.full(shape, NO_PHASE, dtype=np.int16),
            "solved": np.zeros(shape, dtype=bool),
            "force_in_band_raw": np.full(shape, np.nan),
        }

    def add(self, actions: np.ndarray, result: Any, phase: np.ndarray | None, mask: np.ndarray) -> None:
        """Append one step of the worlds in ``mask`` (n,): the action taken and the environment's step result."""
        info = result.info
        row = {
            "reward": result.reward,
            "actions": actions,
            "executed": info["executed_action"],
            "ee_pos": result.obs.get("ee_pos"),
            "phase": phase,
            "solved": info["success"],
            "force_in_band_raw": info.get("force_in_band_raw"),
        }
        row |= {name: info[name] for name in ("ee_error_m", "effort", "contacts", "subtasks")}
        worlds = np.flatnonzero(mask)
        for name, values in row.items():
            if values is not None:
                self._columns[name][self.steps[worlds], worlds] = np.asarray(values)[worlds]
        self.steps[worlds] += 1

    def cut(self, world: int, *, seed: int, success: bool, crash: bool, dropped: bool = False) -> Trace:
        """Return the episode of one world and clear it for its next."""
        length = int(self.steps[world])
        self.steps[world] = 0
        columns = {name: column[:length, world].copy() for name, column in self._columns.items()}
        return Trace(seed=seed, success=success, crash=crash, dropped=dropped, **columns)

"""Demonstrations that are bad in a known way: flown with a fault, or spoiled while they were stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.experts.expert import Expert

LATE_STEPS = 10  # 0.2 s
PAUSE_STEPS = (75, 150)
SHAKE_M = 0.05
GRAB_STEPS, GRABS = 12, 4
DETOUR_M, DETOURS, DETOUR_STEPS = 0.4, 2, 40
FIRST_STEPS = (5, 45)  # in which faults begin


class Faulty:
    """Flies as an expert does, but for a fault; what it flies is what is learned from.

    Args:
        expert: whom it follows. fault: (command, tool position, rng, step of the fault) -> command. steps: that a fault
            lasts. times: how often it comes in an episode; 0 for always.
    """

    def __init__(self, expert: Expert, fault: Callable[..., np.ndarray], *, steps: tuple[int, int], times: int) -> None:
        self._expert, self._fault, self._steps, self._times = expert, fault, steps, times

    @property
    def phase_names(self) -> tuple[str, ...]:
        """Those of the expert."""
        return self._expert.phase_names

    @property
    def phase(self) -> np.ndarray:
        """That of the expert."""
        return self._expert.phase

    def attach(self, env: BatchEnv) -> None:
        """Bind to the environment."""
        self._expert.attach(env)
        self._env, n = env, env.num_envs
        self._rng = [np.random.default_rng(0)] * n
        self._clock = np.zeros(n, int)
        self._spans: list[list[tuple[int, int]]] = [[] for _ in range(n)]
        self._held = np.zeros((n, env.spec.action.size))

    def begin(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Draw when the faults of the episodes that begin come."""
        for world in np.flatnonzero(np.ones(len(seeds), bool) if mask is None else mask):
            rng = named_rng(int(seeds[world]), "fault")
            starts = np.sort(rng.integers(*FIRST_STEPS, self._times))
            self._spans[world] = [(int(s), int(s + rng.integers(*self._steps, endpoint=True))) for s in starts]
            self._rng[world], self._clock[world] = rng, 0

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget what was flown."""
        self._expert.reset(mask)

    def act(self, obs: Observation) -> np.ndarray:
        """Return the expert's actions (n, Da), or what the fault makes of them."""
        actions = self._expert.act(obs).copy()
        for world, spans in enumerate(self._spans):
            begun = [start for start, end in spans if start <= self._clock[world] < end]
            if begun or not self._times:
                tool, since = obs["ee_pos"][world], self._clock[world] - (begun[0] if begun else 0)
                actions[world] = self._fault(actions[world], tool, self._rng[world], since, self._held[world])
            self._held[world] = actions[world]
            self._clock[world] += 1
        return self._env.spec.action.clip(actions)


def pausing(
    command: np.ndarray, tool: np.ndarray, rng: np.random.Generator, since: int, last: np.ndarray
) -> np.ndarray:
    """Hold the last command."""
    return last


def shaking(
    command: np.ndarray, tool: np.ndarray, rng: np.random.Generator, since: int, last: np.ndarray
) -> np.ndarray:
    """Shake by 5 cm from one command to the next."""
    return command + np.concatenate([rng.normal(0.0, SHAKE_M, 3), np.zeros(len(command) - 3)])


def grabbing(
    command: np.ndarray, tool: np.ndarray, rng: np.random.Generator, since: int, last: np.ndarray
) -> np.ndarray:
    """Ask for the utmost in the direction of the command."""
    return np.concatenate([tool + 30.0 * (command[:3] - tool), command[3:]])


def straying(
    command: np.ndarray, tool: np.ndarray, rng: np.random.Generator, since: int, last: np.ndarray
) -> np.ndarray:
    """Fly off sideways, and come back."""
    if since == 0:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        return np.concatenate([tool + DETOUR_M * np.array([np.cos(angle), np.sin(angle), 0.3]), command[3:]])
    return np.concatenate([last[:3], command[3:]])


FLOWN: Mapping[str, Callable[[Expert], Faulty]] = {
    "pausing": lambda expert: Faulty(expert, pausing, steps=PAUSE_STEPS, times=1),
    "shaking": lambda expert: Faulty(expert, shaking, steps=(1, 1), times=0),
    "grabbing": lambda expert: Faulty(expert, grabbing, steps=(GRAB_STEPS, GRAB_STEPS), times=GRABS),
    "straying": lambda expert: Faulty(expert, straying, steps=(DETOUR_STEPS, DETOUR_STEPS), times=DETOURS),
}


def late(episode: Episode) -> Episode:
    """Return an episode whose actions were stored 0.2 s after they were flown."""
    shift = np.maximum(np.arange(len(episode)) - LATE_STEPS, 0)
    delayed = {name: getattr(episode, name)[shift] for name in ("actions", "executed_actions", "expert_actions")}
    return replace(episode, uid=f"{episode.uid}-late", **delayed)


def repeated(episode: Episode) -> Episode:
    """Return an episode once more, under another name."""
    return replace(episode, uid=f"{episode.uid}-again")


SPOILED: Mapping[str, Callable[[Episode], Episode]] = {"late": late, "repeated": repeated}
KINDS = (*FLOWN, *SPOILED)

"""Policies that know nothing of the task: what every expert and every trained policy must beat."""

from __future__ import annotations

from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Observation
from aerial_il.core.seeding import named_rng
from aerial_il.suite.staying import stay_action

HOLD_STEPS = 10  # a new action in every step would average out to none


class Random:
    """Draw actions uniformly from their bounds, hold each for ten steps; each episode has a stream of its own."""

    def __init__(self) -> None:
        self._env: Any = None

    def attach(self, env: Any) -> None:
        self._env, self._rngs = env, [None] * env.num_envs
        self._steps, self._held = np.zeros(env.num_envs, int), np.zeros((env.num_envs, env.spec.action.size))

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._steps[slice(None) if mask is None else mask] = 0

    def act(self, obs: Observation) -> np.ndarray:
        env = _attached(self._env)
        low, high, seeds = env.spec.action.low, env.spec.action.high, env.seeds
        for world in np.flatnonzero(self._steps % HOLD_STEPS == 0):
            if self._steps[world] == 0:
                self._rngs[world] = named_rng(int(seeds[world]), "random policy")
            self._held[world] = self._rngs[world].uniform(low, high)
        self._steps += 1
        return self._held.copy()


class Hover:
    """Command the vehicle to stay where the episode began."""

    def __init__(self) -> None:
        self._env: Any = None

    def attach(self, env: Any) -> None:
        self._env, self._held = env, np.zeros((env.num_envs, env.spec.action.size))
        self._fresh = np.ones(env.num_envs, bool)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._fresh[slice(None) if mask is None else mask] = True

    def act(self, obs: Observation) -> np.ndarray:
        env = _attached(self._env)
        for world in np.flatnonzero(self._fresh):
            self._held[world] = stay_action(env.scenario, env.simulation.view, int(world))
        self._fresh[:] = False
        return self._held.copy()


BASELINES = {"random": Random, "hover": Hover}


def _attached(env: Any) -> Any:
    if env is None:
        raise InvalidValueError("The policy is not attached to an environment; call policy.attach(env) first.")
    return env

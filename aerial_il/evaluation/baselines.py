"""Policies that know nothing of the task: what every expert and every trained policy must beat."""

import numpy as np

from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode.hold_action import hold_action
from aerial_il.suite.late import LateBatch

HOLD_STEPS = 10  # a new action in every step would average out to none


class Random:
    """Draw actions uniformly from their bounds, hold each for ten steps; each episode has a stream of its own."""

    def __init__(self) -> None:
        self._env: BatchEnv | None = None

    def attach(self, env: BatchEnv) -> None:
        self._env = env
        self._rngs: list[np.random.Generator | None] = [None] * env.num_envs
        self._steps, self._held = np.zeros(env.num_envs, int), np.zeros((env.num_envs, env.spec.action.size))

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._steps[slice(None) if mask is None else mask] = 0

    def act(self, obs: Observation) -> np.ndarray:
        env = _attached(self._env)
        bounds, seeds = env.spec.action, env.seeds
        for world in np.flatnonzero(self._steps % HOLD_STEPS == 0):
            rng = None if self._steps[world] == 0 else self._rngs[world]
            rng = self._rngs[world] = rng or named_rng(int(seeds[world]), "random policy")
            self._held[world] = rng.uniform(bounds.low, bounds.high)
        self._steps += 1
        return self._held.copy()


class Hover:
    """Command the vehicle to stay where the episode began."""

    def __init__(self) -> None:
        self._env: BatchEnvironment | LateBatch | None = None

    def attach(self, env: BatchEnv) -> None:
        """Bind to the environment whose vehicle it holds.

        Raises:
            InvalidValueError: the environment is not the suite's.
        """
        if not isinstance(env, BatchEnvironment | LateBatch):
            where = f"{env.spec.robot}:{env.spec.task}"
            raise InvalidValueError(
                f"policy=hover holds a vehicle of our own environments, not {where}. Try policy=random."
            )
        self._env, self._held = env, np.zeros((env.num_envs, env.spec.action.size))
        self._fresh = np.ones(env.num_envs, bool)

    def reset(self, mask: np.ndarray | None = None) -> None:
        self._fresh[slice(None) if mask is None else mask] = True

    def act(self, obs: Observation) -> np.ndarray:
        env = _attached(self._env)
        for world in np.flatnonzero(self._fresh):
            self._held[world] = hold_action(env.scenario, env.simulation.view, int(world))
        self._fresh[:] = False
        return self._held.copy()


BASELINES = {"random": Random, "hover": Hover}


def _attached[Env: BatchEnv](env: Env | None) -> Env:
    if env is None:
        raise InvalidValueError("The policy is not attached to an environment; call policy.attach(env) first.")
    return env

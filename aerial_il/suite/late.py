"""Worlds that are seen late and act late, by whole control steps that are the same for all episodes.

Unlike the disturbance ``latency``, which a tier draws for each episode and keeps in its state, this is a property of
the robot that whoever flies it may know. Until the first action arrives the vehicle stays where it began.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerial_il.core.contracts import BatchEnv, StepResult
from aerial_il.core.env_wrapper import BatchEnvWrapper
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode.hold_action import hold_action

Seen = dict[str, np.ndarray]


class LateBatch(BatchEnvWrapper):
    """Shows the observations of ``env`` late and executes actions late; all else, rewards and ends too, is its own."""

    def __init__(self, env: BatchEnvironment, latency: Latency) -> None:
        super().__init__(env)
        self.latency, self.spec = latency, env.spec
        self.simulation, self.scenario = env.simulation, env.scenario  # an expert looks there
        seen_late, done_late = latency.steps(env.spec.control_dt_s)
        self._seen: list[Seen] = [{} for _ in range(seen_late + 1)]  # oldest first
        self._sent = np.zeros((done_late + 1, env.num_envs, env.spec.action.size))  # the next to arrive first

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> Seen:
        """Start episodes as ``env`` does: nothing older is seen than their beginning."""
        obs = self.env.reset(seeds, mask)
        fresh = np.ones(self.env.num_envs, bool) if mask is None else mask
        self._seen = [_merged(old, obs, fresh) for old in self._seen]
        for world in np.flatnonzero(fresh):
            self._sent[:, world] = hold_action(self.scenario, self.simulation.view, int(world))
        return self.observe()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Take a step with the actions that arrive now, and show what was there a while ago."""
        moving = np.ones(self.env.num_envs, bool) if mask is None else mask
        self._sent[:, moving] = np.concatenate([self._sent[1:, moving], np.asarray(actions, float)[None, moving]])
        result = self.env.step(self._sent[0], mask)
        later = [*self._seen[1:], result.obs]
        self._seen = [_merged(old, new, moving) for old, new in zip(self._seen, later, strict=True)]
        return replace(result, obs=self.observe())

    def observe(self) -> Seen:
        """Observations of all worlds as they are seen now, ``name -> (n, ...)``."""
        return {name: values.copy() for name, values in self._seen[0].items()}

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> Seen:
        """Refuse: what is on its way is no part of a state.

        Raises:
            InvalidValueError: always.
        """
        raise InvalidValueError("Worlds with latency cannot continue from a state: what is on its way is not in it.")


def late(env: BatchEnv, latency: Latency) -> BatchEnv:
    """Return ``env`` with latency, or itself without.

    Raises:
        InvalidValueError: a delay is no whole number of control steps, or the environment is not the suite's.
    """
    if not latency.total_ms:
        return env
    if not isinstance(env, BatchEnvironment):
        where = f"{env.spec.robot}:{env.spec.task}"
        raise InvalidValueError(f"latency is the suite's; {where} is from outside. Leave out latency.")
    return LateBatch(env, latency)


def _merged(old: Seen, new: Seen, mask: np.ndarray) -> Seen:
    """Return ``new`` in the worlds of ``mask`` (n,), ``old`` in the others."""
    if not old:
        return {name: values.copy() for name, values in new.items()}
    return {name: np.where(_against(mask, values), values, old[name]) for name, values in new.items()}


def _against(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    return mask.reshape(-1, *[1] * (values.ndim - 1))

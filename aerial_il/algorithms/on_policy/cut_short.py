"""Worlds whose episodes are truncated sooner than they would be: a flight that is stuck teaches little for its time."""

from dataclasses import replace

import numpy as np

from aerial_il.core.contracts import BatchEnv, StepResult
from aerial_il.core.env_wrapper import BatchEnvWrapper


class CutShort(BatchEnvWrapper):
    """Truncates the episodes of ``env`` after ``longest`` steps; all else is its own."""

    def __init__(self, env: BatchEnv, longest: int) -> None:
        super().__init__(env)
        self._longest, self._ages = longest, np.zeros(env.num_envs, np.int64)

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Start episodes as ``env`` does, and count anew."""
        self._ages[np.ones(len(self._ages), bool) if mask is None else mask] = 0
        return self.env.reset(seeds, mask)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Take a step as ``env`` does; worlds whose time is over are truncated."""
        result = self.env.step(actions, mask)
        self._ages += 1 if mask is None else mask
        solved = np.asarray(result.info.get("success", np.zeros(len(self._ages))), bool) & self.env.ends_at_success
        over = (self._ages >= self._longest) & ~result.terminated & ~solved
        return replace(result, truncated=result.truncated | over)


def uncut(env: BatchEnv) -> BatchEnv:
    """Return the environment itself, for code that reads its simulator."""
    return env.env if isinstance(env, CutShort) else env


def cut_short(env: BatchEnv, longest: int) -> BatchEnv:
    """Return ``env`` with episodes of at most ``longest`` steps."""
    return CutShort(env, longest) if longest < env.spec.max_steps else env

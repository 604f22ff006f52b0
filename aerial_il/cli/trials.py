"""Rollouts while a policy learns: few, on the same seeds each time, and none of those that judge it in the end."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

JUDGING_SEED = 10_000  # evaluations take seeds from here on


@dataclass
class Trials:
    """Flies a policy in the environment of its demonstrations.

    Attributes:
        episodes, seed: how many seeds, and the first of them. tier: how rough the air is; None for the dataset's.
        num_envs: worlds flown at once. threads: of the simulation, or processes of worlds from outside; 0 for all
            cores.
    """

    episodes: int
    seed: int
    tier: str | None = None
    num_envs: int = 64
    threads: int = 0
    _env: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.seed < JUDGING_SEED < self.seed + self.episodes or self.seed >= JUDGING_SEED:
            raise InvalidValueError(
                f"evaluate_seed={self.seed} with evaluate_episodes={self.episodes} would use seeds from {JUDGING_SEED} "
                "on, which judge the finished policy. Choose smaller ones."
            )

    def __call__(self, policy: ChunkPolicy, step: int) -> dict[str, float]:
        """Return success with its 95 % interval, mean reward, time to success and crashes."""
        from aerial_il.evaluation.rollouts import evaluate

        seeds = range(self.seed, self.seed + self.episodes)
        result = evaluate(self._environment(policy), policy, seeds, policy_name=f"step {step}", progress=False)
        low, high = result.success["ci95"]
        time_s = result.metrics["time_to_success_s"]["mean"]
        return {
            "success": result.success["rate"],
            "success_low": low,
            "success_high": high,
            "episodes": len(result.episodes),
            "mean_reward": sum(episode.mean_reward for episode in result.episodes) / len(result.episodes),
            "time_to_success_s": float("nan") if time_s is None else time_s,
            "crashes": result.metrics["ends"]["crash"],
        }

    def _environment(self, policy: ChunkPolicy) -> Any:
        """Return the batch environment, loaded when it is needed first."""
        from aerial_il.cli.flying import pilot_of

        if self._env is None:
            worlds, tier = min(self.num_envs, self.episodes), self.tier or policy.spec.tier
            law = policy.spec.controller
            self._env = pilot_of(policy).environment(tier, num_envs=worlds, threads=self.threads, controller=law)
        return self._env

    @contextmanager
    def open(self) -> Iterator[Trials]:
        """Close the environment in the end."""
        try:
            yield self
        finally:
            if self._env is not None:
                self._env.close()

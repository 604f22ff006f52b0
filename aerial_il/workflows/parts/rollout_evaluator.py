"""Rollouts while a policy learns: few, on the same seeds each time, and none of those that judge it in the end."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.evaluation.metrics import EpisodeRecord
    from aerial_il.evaluation.result import EvaluationResult
    from aerial_il.policies.parts.chunk_policy import ChunkPolicy

JUDGING_SEED = 10_000  # evaluations take seeds from here on


@dataclass
class RolloutEvaluator:
    """Flies a policy in the environment of its demonstrations, or in those of each of its tasks.

    Attributes:
        episodes, seed: how many flights, and the first of their seeds; several tasks share the flights evenly, rounded
            up, and each of them begins with that seed.
        tier: how rough the air is; None for the dataset's.
        num_envs: worlds flown at once. threads: of the simulation, or processes of external environments; 0 for all
            cores.
        env: ``env=`` as the user typed it, which alone may name a module to import.
    """

    episodes: int
    seed: int
    tier: str | None = None
    num_envs: int = 64
    threads: int = 0
    env: str | None = None
    _envs: tuple[Any, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        if self.seed < JUDGING_SEED < self.seed + self.episodes or self.seed >= JUDGING_SEED:
            raise InvalidValueError(
                f"evaluate_seed={self.seed} with evaluate_episodes={self.episodes} would use seeds from {JUDGING_SEED} "
                "on, which are kept for the finished policy. Choose smaller ones."
            )

    def __call__(self, policy: ChunkPolicy, step: int) -> dict[str, float]:
        """Return success with its 95 % interval, mean reward, time to success and crashes, over all tasks together.

        Of several tasks ``success/<task>`` says how it went in each.
        """
        flown = [self._fly(env, policy, step) for env in self._environments(policy)]
        rates = {f"success/{result.task}": result.success["rate"] for result in flown} if len(flown) > 1 else {}
        return _summary([episode for result in flown for episode in result.episodes]) | rates

    def _fly(self, env: BatchEnv, policy: ChunkPolicy, step: int) -> EvaluationResult:
        from aerial_il.evaluation.rollouts import evaluate

        seeds = range(self.seed, self.seed + self._share(len(self._envs)))
        return evaluate(env, policy, seeds, policy_name=f"step {step}", progress=False)

    def _environments(self, policy: ChunkPolicy) -> tuple[Any, ...]:
        """Return the batch environment of each task, loaded when they are needed first."""
        from aerial_il.workflows.parts.pilots import pilots_of

        if not self._envs:
            pilots, tier, law = pilots_of(policy, typed=self.env), self.tier or policy.spec.tier, policy.spec.controller
            worlds = min(self.num_envs, self._share(len(pilots)))
            for pilot in pilots:  # one by one, so that those that were opened are closed if the next one fails
                env = pilot.environment(tier, num_envs=worlds, threads=self.threads, controller=law)
                self._envs = (*self._envs, env)
        return self._envs

    def _share(self, tasks: int) -> int:
        """Return how many of the flights are each task's."""
        return -(-self.episodes // tasks)

    @contextmanager
    def open(self) -> Iterator[RolloutEvaluator]:
        """Close the environments in the end."""
        try:
            yield self
        finally:
            for env in self._envs:
                env.close()


def _summary(episodes: list[EpisodeRecord]) -> dict[str, float]:
    """Return what a training logs of its rollouts."""
    from aerial_il.evaluation.metrics import proportion

    success = proportion([episode.success for episode in episodes])
    times = [episode.time_to_success_s for episode in episodes if episode.time_to_success_s is not None]
    low, high = success["ci95"]
    return {
        "success": success["rate"],
        "success_low": low,
        "success_high": high,
        "episodes": len(episodes),
        "mean_reward": sum(episode.mean_reward for episode in episodes) / len(episodes),
        "time_to_success_s": sum(times) / len(times) if times else float("nan"),
        "crashes": sum(episode.end == "crash" for episode in episodes),
        "dropped": sum(episode.end == "dropped" for episode in episodes),
    }

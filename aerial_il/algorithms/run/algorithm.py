"""The one base of algorithms that learn while they fly: it opens a run, and states no settings of its own."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import ClassVar

from aerial_il.algorithms.rl.interface import check_policy
from aerial_il.algorithms.rl.online_run import OnlineRun, Problem, open_run
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian

TOO_SHORT = (
    "steps is {} and {} {}: the run would end before its policy has learned anything. Set algorithm.steps well above "
    "{}, or lower algorithm.{}."
)


@dataclass(frozen=True, kw_only=True)
class Cadence:
    """When a run reports, saves and gives up; no weight depends on it.

    Attributes:
        log_every: environment steps between two rows of the metrics; 0 for never.
        evaluate_every: between two evaluations; 0 for never.
        checkpoint_every: between two checkpoints; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        reward_patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
    """

    log_every: int
    evaluate_every: int
    checkpoint_every: int
    keep_checkpoints: int
    reward_patience: int

    def __post_init__(self) -> None:
        require_positive(self, "keep_checkpoints")
        require_not_negative(self, "log_every", "evaluate_every", "checkpoint_every", "reward_patience")


class Algorithm(ABC):
    """What a workflow asks of an algorithm. Settings stand in the dataclass of each; here is what names mean in all.

    Attributes:
        steps: environment steps, of all worlds together.
        warmup: of those, how many are flown at random, or by the prior, before the actor improves.
        gamma: discount.
        lr: learning rate of all that is learned, at the start; it changes linearly.
        lr_floor: what is left of it at the end, as a share. Below 1 the final policy swings less.
        actor_every: how many of the critics' gradient steps for each one of the actor.
        alpha: temperature at the start: weight of the entropy beside the reward.
        entropy: target entropy for each action element.
        reward: the ``environment``'s own, dense in the suite; or ``sparse``, 1 for success.
        prior: a run or policy of the same class and sizes, whose weights the actor starts from; null for random ones.
        obs_norm: standardise observations by their moments in the warm-up, which are fixed from then on.
        threads: torch threads; results repeat bit for bit at a fixed number only.
    """

    name: ClassVar[str]  # that of its module
    needs: ClassVar[tuple[str, ...]] = ("env",)  # what it is handed
    rewarded: ClassVar[bool] = True
    demonstrated: ClassVar[bool] = False
    worlds: ClassVar[int] = 8
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian,)

    steps: int
    warmup: int
    cadence: Cadence

    def __post_init__(self) -> None:
        stated = {field.name for field in fields(self)}  # type: ignore[arg-type]
        require_positive(self, *(stated & {"steps", "warmup", "lr", "actor_every", "alpha", "threads"}))
        require_share(self, "gamma", below_one=True)
        require_share(self, *(stated & {"lr_floor"}))

    def train(
        self,
        dataset: Iterable[Episode] | None,
        policy: PolicySettings,
        *,
        env: BatchEnv,
        run: str | os.PathLike[str],
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn by acting in ``env``; a finished run returns its policy at once."""
        flown = -(-self.warmup // env.num_envs) * env.num_envs
        if self.steps <= flown and not getattr(self, "offline_steps", 0):
            raise InvalidValueError(TOO_SHORT.format(self.steps, "warmup", self.warmup, flown, "warmup"))
        problem = self.problem(dataset, check_policy(policy, self.trains), env, seed)
        with open_run(self, problem, run, evaluate=evaluate, resume=resume, progress=progress) as opened:
            return self.learn(opened) if opened else load_policy(run)

    @abstractmethod
    def problem(
        self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int
    ) -> Problem: ...

    @abstractmethod
    def learn(self, run: OnlineRun) -> ChunkPolicy: ...

    # Read by a run until all algorithms state a cadence.
    log_every = property(lambda self: self.cadence.log_every)
    evaluate_every = property(lambda self: self.cadence.evaluate_every)
    checkpoint_every = property(lambda self: self.cadence.checkpoint_every)
    keep_checkpoints = property(lambda self: self.cadence.keep_checkpoints)

"""The base of algorithms that collect experience while they learn: common settings, and the opening of a run."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.online.collector import RewardScheme
from aerial_il.algorithms.online.interface import check_policy, plain_interface
from aerial_il.algorithms.online.problem import Problem, check_steps
from aerial_il.algorithms.online.run import OnlineRun, open_run
from aerial_il.algorithms.run.cadence import Cadence, Evaluate
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.settings import make_tuples
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class OnlineAlgorithm(ABC):
    """Settings of every run that collects experience while it learns; :meth:`learn` is the algorithm.

    Attributes:
        steps: environment steps, of all worlds together.
        gamma: discount.
        log_every, evaluate_every, checkpoint_every: environment steps between two; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        threads: torch threads; results repeat bit for bit at a fixed number only.
        name: of the algorithm, that of its module.
        needs, worlds: what a command hands to ``train``, and how many worlds that has.
        rewarded, demonstrated: whether it learns from the environment's reward, and whether from demonstrations.
        trains: kinds of policy.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ("env",)
    rewarded: ClassVar[bool] = True
    demonstrated: ClassVar[bool] = False
    worlds: ClassVar[int] = 8
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian,)

    steps: int = 300_000
    gamma: float = 0.99
    log_every: int = 5_000
    evaluate_every: int = 0
    checkpoint_every: int = 50_000
    keep_checkpoints: int = 2
    threads: int = 1

    def __post_init__(self) -> None:
        make_tuples(self)
        require_positive(self, "steps", "keep_checkpoints", "threads")
        require_share(self, "gamma", below_one=True)
        require_not_negative(self, "log_every", "evaluate_every", "checkpoint_every")

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
        """Learn by acting in ``env``.

        Args:
            dataset: episodes of that environment to imitate, failures among them left out; not looked at by an
                algorithm that is not ``demonstrated``.
            policy: what to train, one of those that the algorithm ``trains``.
            env: a batch environment to act in; it is reset.
            run: folder for configuration, metrics, checkpoints, a learned reward and the finished policy.
            seed: decides initial weights, exploration, minibatches and which episodes are flown.
            evaluate: ``(policy, step) -> named numbers`` to log every ``evaluate_every`` steps and at the end.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.

        Raises:
            InvalidValueError: nothing to learn from, or in too few steps; another kind of policy or environment; or
                ``run`` holds another.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        for name, flown in self.flown_before_learning(env.num_envs).items():
            check_steps(self, name, flown)
        problem = self.problem(dataset, check_policy(policy, self.trains), env, seed)
        with open_run(self, problem, run, evaluate=evaluate, resume=resume, progress=progress) as opened:
            return self.learn(opened) if opened else load_policy(run)

    @abstractmethod
    def learn(self, run: OnlineRun) -> ChunkPolicy:
        """Collect and learn until the run has no steps left; return the trained policy."""

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        """Return the environment steps of so many ``worlds`` that pass before the policy learns, by the settings."""
        return {}

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Return what is learned on: here the environment and its reward alone."""
        interface = plain_interface(Layout.of(env.spec, policy), policy)
        return Problem(self.name, seed, policy, env, interface, scheme=self.scheme)

    @property
    def cadence(self) -> Cadence:
        """When it reports and saves."""
        names = ("log_every", "evaluate_every", "checkpoint_every", "keep_checkpoints")
        return Cadence(**{name: getattr(self, name) for name in names})

    @property
    def scheme(self) -> RewardScheme:
        """How its steps are rewarded: here by the environment alone."""
        return RewardScheme()

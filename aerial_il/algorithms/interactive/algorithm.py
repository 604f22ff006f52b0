"""The base of algorithms that learn in rounds with an expert at hand: the opening of a run."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass

from aerial_il.algorithms.interactive.problem import Collect, InteractiveProblem, Operator
from aerial_il.algorithms.interactive.rounds import Rounds
from aerial_il.algorithms.interactive.settings import InteractiveSettings
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings


@dataclass(frozen=True, kw_only=True)
class InteractiveAlgorithm(InteractiveSettings, ABC):
    """Settings of a run, see :class:`InteractiveSettings`; :meth:`learn` is the algorithm."""

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        run: str | os.PathLike[str],
        env: BatchEnv,
        collect: Collect,
        expert: Policy | Operator | None = None,
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn by flying.

        Args:
            dataset: demonstrations to begin with, flown in the same kind of environment; failures are left out.
            policy: what to train.
            run: folder of the run; see :mod:`aerial_il.algorithms.interactive.rounds`.
            env: batch environment to fly in. expert: whom to ask, or who sits at the controls. collect: records
                flights.
            seed: decides weights, minibatches, coins and the seeds of the flights.
            evaluate: ``(policy, round) -> named numbers`` from flights on seeds of its own.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show progress bars.

        Returns:
            The policy of the last round, as saved in ``run/policy``.

        Raises:
            InvalidValueError: demonstrations of another environment, no expert, or ``run`` holds another run.
            SimulationDivergedError, StorageError: from the flights. The errors of supervised learning.
        """
        problem = InteractiveProblem(self, policy, seed, env, expert, collect, progress)
        with Rounds.open(run, dataset, problem, resume=resume) as rounds:
            return self.learn(rounds, evaluate) if rounds.finished is None else rounds.finished

    @abstractmethod
    def learn(self, rounds: Rounds, evaluate: Evaluate | None) -> ChunkPolicy:
        """Fly and learn until no round is left; return the trained policy."""

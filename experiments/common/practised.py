"""Trainings that go on from a few demonstrations by flying, and one that flies without any."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from aerial_il import experts
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.on_policy.from_clone import FromClone
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.cadence import Evaluate
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.composition import changed
from aerial_il.core.contracts import Policy
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.seeds import TUNING_SEEDS
from experiments.common.stages import Cloned, Shown, Stages, all_that_decides, train_in_rounds

Practising = ExpertIteration | FilteredBC | Algorithm

ON_POLICY_WORLDS = 64
WATCHED_FLIGHTS = 200


@dataclass(frozen=True, eq=False)
class Practised(Shown):
    """A policy that goes on from its demonstrations by flying, in rounds.

    Attributes:
        algorithm: how, beside those of :class:`Shown`.
    """

    algorithm: ExpertIteration | FilteredBC

    def decided_by(self) -> dict[str, Any]:
        return all_that_decides(self)

    def train(self, stages: Stages, run: Path) -> Policy:
        return train_in_rounds(self, self.algorithm, stages, run, worlds=self.algorithm.worlds, expert=None)

    def flown(self, run: Path) -> int:
        """Return the control steps that it flew by itself, in the folder ``run``."""
        return sum(int(row["flight_steps"]) for row in read_metrics(run))


@dataclass(frozen=True, eq=False)
class Continued(Shown):
    """A policy that learns step by step; from the very one that stands beside it, where it begins with one.

    Attributes:
        algorithm: how, beside those of :class:`Shown`; its ``prior``, where it has one, is that policy.
        beginning: what it begins with, if its algorithm has a prior: a clone, or what has practised in rounds.
        watched: how many times on the way, evenly spread, it is flown without exploration if it begins with a policy,
            which is flown first; no weight depends on it.
    """

    algorithm: Algorithm
    beginning: Cloned | Practised
    watched: int = 0

    @property
    def prior(self) -> Cloned | Practised | None:
        """What it begins with; None where its algorithm has no prior."""
        return self.beginning if any(setting.name == "prior" for setting in fields(self.algorithm)) else None

    @property
    def _is_watched(self) -> bool:
        return self.watched > 0 and self.prior is not None

    @property
    def worlds(self) -> int:
        """How many worlds it flies in at once."""
        return max(self.algorithm.worlds, ON_POLICY_WORLDS if hasattr(self.algorithm, "rollout") else 1)

    @property
    def trained(self) -> PolicySettings:
        """What is trained: the prior's own kind, or the one that the algorithm knows."""
        return self.policy if isinstance(self.policy, self.algorithm.trains) else SquashedGaussian()

    def decided_by(self) -> dict[str, Any]:
        own = all_that_decides(self)
        return {**own, "worlds": self.worlds, "clone": self.prior.decided_by() if self.prior else None}

    def train(self, stages: Stages, run: Path) -> Policy:
        every = math.ceil(self.algorithm.steps / self.watched) if self._is_watched else 0
        settings: Any = changed(self.algorithm, {"cadence": {"evaluate_every": every}})
        source = self.source
        if self.prior:
            stages.policy(self.prior)
            settings = replace(settings, prior=str(stages.run_of(self.prior)))
        expert = experts.make(source.robot, source.task) if "expert" in settings.needs else None
        env = stages.environment(source, source.tier, self.worlds)
        try:
            return settings.train(
                stages.demonstrations(source, self.demos) if settings.demonstrated else None,
                self.trained,
                run=run,
                env=env,
                seed=source.draw,
                progress=stages.progress,
                evaluate=self._watch(stages),
                **({"expert": expert} if isinstance(settings, FromClone) else {}),
            )
        finally:
            env.close()

    def flown(self, run: Path) -> int:
        """Return the control steps that it flew by itself, in the folder ``run``, without those of its beginning."""
        return int(read_metrics(run)[-1]["step"])

    def _watch(self, stages: Stages) -> Evaluate | None:
        """Return what flies the policy on the way, always on the same tuning seeds in the tier it practises in."""
        seeds = TUNING_SEEDS[:WATCHED_FLIGHTS]

        def seen(policy: Policy, step: int) -> dict[str, float]:
            env = stages.environment(self.source, self.source.tier, min(stages.num_envs, len(seeds)))
            try:
                result = evaluate(env, policy, seeds, policy_name=f"{self.label} at {step}", progress=False)
            finally:
                env.close()
            return {"success": result.success["rate"], "episodes": float(len(seeds))}

        return seen if self._is_watched else None

"""Jump-start reinforcement learning (JSRL): a guide flies the first steps of each episode, the learner the rest.

The guide is any policy, ``guide=RUN``, or the task's own expert; it never changes, and what it flies is not learned
from. So the learner starts near the end, where even a sparse reward is found, and is handed more of the task as it
manages what it has:

- ``schedule=curriculum``: the guide's part is ``horizon`` steps at first and shrinks by one of ``stages`` each time
  the last ``window`` episodes return as much as the best window so far, but for the share ``tolerance``;
- ``schedule=random``: for each episode it is sampled from 0 to ``horizon`` steps.

The learner is a clone of the demonstrations, or ``prior=RUN``, which goes on by PPO, chunk by chunk, as in ``bc_ppo``,
with the pull back to the clone; with ``cloning.steps=1`` it is hardly more than a new network. There is no gate: what
an episode returns is the guide's work, too.

Metrics: those of ``bc_ppo`` without ``actor/fallbacks``; ``guide/steps`` of episodes that begin; ``guide/stage``;
``rollout/reward`` of a step, whichever policy acted;
``episode/...`` are of guide and learner together, ``evaluate/...`` of the learner alone.

Source: I. Uchendu et al., "Jump-Start Reinforcement Learning", 2023, algorithm 1 and section 4.3. There the learner is
off-policy (IQL) and learns from the guide's steps too; here it is on-policy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.bc_ppo import AnchoredActorCritic
from aerial_il.algorithms.decisions.chunk_actor import ChunkPilot
from aerial_il.algorithms.decisions.guided import Curriculum, GuidedPilot, Schedule
from aerial_il.algorithms.decisions.practice import AnchoredOnPolicy, Practice, PractisedChunks
from aerial_il.algorithms.decisions.rollout import collect_decisions, judged
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_choice, require_not_negative, require_positive, require_share
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

TOO_FAR = (
    "The guide would fly {} steps (algorithm.horizon; by default the longest demonstration), and episodes of practice "
    "are cut after {}: it may fly at most that. Set a smaller algorithm.horizon, or a larger algorithm.patience than "
    "{:g}."
)
NO_GUIDE = "jsrl lets a guide fly first, and there is no expert for {}: say algorithm.guide=RUN."


@dataclass(frozen=True, kw_only=True)
class JSRL(PractisedChunks, AnchoredOnPolicy):
    """Settings of a run, beside those of :class:`PractisedChunks` and :class:`AnchoredOnPolicy`.

    Attributes:
        guide: a run or policy of any class; None for the expert.
        schedule, stages, window, tolerance: see :class:`Curriculum`.
        horizon: the guide's steps at first; 0 for the length of the longest demonstration.
        warmup: environment steps of the learner's own in which only a critic learns; the guide's do not count.
    """

    name: ClassVar[str] = "jsrl"
    needs: ClassVar[tuple[str, ...]] = ("env", "expert")

    steps: int = 16_000_000
    gamma: float = 0.995
    guide: str | None = None
    schedule: Schedule = "curriculum"
    horizon: int = 0
    stages: int = 10
    window: int = 100
    tolerance: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "schedule", Schedule)
        require_not_negative(self, "horizon")
        require_positive(self, "stages", "window")
        require_share(self, "tolerance")

    def inputs(self, spec: EnvSpec, expert: Policy | None, demos: Sequence[Episode]) -> Mapping[str, str]:
        """Return the digest of a guide that was trained.

        Raises:
            InvalidValueError: there is no guide, it cannot fly here, or it would fly on when episodes are over.
        """
        horizon, limit = self.curriculum(demos).horizon, min(spec.max_steps, self.longest(demos))
        if horizon > limit:
            raise InvalidValueError(TOO_FAR.format(horizon, limit, self.patience))
        if self.guide:
            return {"guide": digest(Checkpoint(load_prior(self.guide, spec, key="guide").to_checkpoint().arrays))}
        if not isinstance(expert, Policy):
            raise InvalidValueError(NO_GUIDE.format(f"{spec.task} on {spec.robot}"))
        return {}

    def practise(self, practice: Practice) -> ChunkPolicy:
        run, prior, actor = practice.run, practice.prior, self.actor(practice)
        size = prior.config.history * run.sizes[0]
        agent = AnchoredActorCritic(self, actor, size, smoothness=self.smoothness)
        guide = load_prior(self.guide, run.collector.env.spec, key="guide") if self.guide else practice.expert
        assert guide is not None, "checked before the run was opened"
        learner, curriculum = ChunkPilot(actor, prior, run.collector), self.curriculum(practice.demos)
        pilot = GuidedPilot(learner, guide, run.collector, curriculum, run.rng("guide"))
        reward_norm = RewardNorm(run.collector.n, self.gamma)
        hand_over = self.hand_over(practice, actor)
        parts = {"agent": agent, "pilot": pilot, "reward_norm": reward_norm, "hand_over": hand_over}
        run.begin(actor.network, parts)

        while run.goes_on():
            warming_up = pilot.flown < self.warmup
            decisions = collect_decisions(run.collector, pilot, self.rollout)
            rewards = reward_norm.scale(decisions.rewards, decisions.ended)
            paid = float(decisions.rewards.mean())
            run.log({"guide/steps": pilot.steps, "guide/stage": pilot.stage, "rollout/reward": paid})
            if decisions.decided.sum() > 1:  # where the guide flies whole episodes there is nothing to learn
                found = judged(decisions, agent.values, rewards, gamma=self.gamma, gae_lambda=self.gae_lambda)
                run.log(agent.learn(found.data, left=run.left, improve=not warming_up))
                run.log({"critic/value": found.value})
                run.log({} if warming_up else hand_over.after_learning())
            run.end_turn()

        return hand_over.finish()

    def curriculum(self, demos: Sequence[Episode]) -> Curriculum:
        """Return how the guide's part shrinks, from as long as the longest demonstration where none is specified."""
        return Curriculum(
            schedule=self.schedule,
            horizon=self.horizon or max(map(len, demos)),
            stages=self.stages,
            window=self.window,
            tolerance=self.tolerance,
        )

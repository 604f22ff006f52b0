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

Metrics: those of ``bc_ppo`` without ``actor/fallbacks``; ``guide/steps`` of episodes that start; ``guide/stage``;
``rollout/reward`` of a step, whichever policy acted;
``episode/...`` are of guide and learner together, ``evaluate/...`` of the learner alone.

Source: I. Uchendu et al., "Jump-Start Reinforcement Learning", 2023, algorithm 1 and section 4.3. There the learner is
off-policy (IQL) and learns from the guide's steps too; here it is on-policy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import AnchoredActorCritic
from aerial_il.algorithms.on_policy.chunk_actor import ChunkPilot
from aerial_il.algorithms.on_policy.decisions import Decisions
from aerial_il.algorithms.on_policy.from_clone import FromClone, Start
from aerial_il.algorithms.on_policy.guided import Curriculum, GuidedPilot, Schedule
from aerial_il.algorithms.on_policy.hand_over import HandOver
from aerial_il.algorithms.on_policy.loop import learn_on_policy
from aerial_il.algorithms.on_policy.settings import Exploration, Rollout, Trial
from aerial_il.algorithms.online.problem import Source
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.prior import load_prior
from aerial_il.core.checkpoint import Checkpoint, digest
from aerial_il.core.checks import require_choice, require_not_negative, require_positive, require_share
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode

TOO_FAR = (
    "The guide would fly {} steps (algorithm.horizon; by default the longest demonstration), and episodes of practice "
    "are cut after {}: it may fly at most that. Set a smaller algorithm.horizon, or a larger algorithm.patience than "
    "{:g}."
)
NO_GUIDE = "jsrl lets a guide fly first, and there is no expert for {}: say algorithm.guide=RUN."


@dataclass(frozen=True, kw_only=True)
class JSRL(FromClone):
    """Jump-start reinforcement learning (Uchendu et al. 2023), by PPO from a clone.

    Attributes:
        warmup: environment steps of the learner's own in which only a critic learns; the guide's do not count.
        lr: the actor's learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
        guide: a run or policy of any class; null for the expert.
        schedule: how the guide's part shrinks: stage by stage, ``curriculum``; or ``random``, sampled for each episode.
        horizon: the guide's steps at first, and at most; 0 for the length of the longest demonstration.
        stages: in which they shrink to none.
        window: episodes that decide whether a stage is passed.
        tolerance: share of the best window's return that may be missing.
    """

    name: ClassVar[str] = "jsrl"
    needs: ClassVar[tuple[str, ...]] = ("env", "expert")

    steps: int = 4_000_000
    warmup: int = 50_000
    gamma: float = 0.995
    gae_lambda: float = 0.95
    lr: float = 5e-5
    critic_lr: float = 1e-3
    critic_hidden: tuple[int, ...] = (128, 128)
    clip: float = 0.9
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 1.0
    kl: float = 0.001
    guide: str | None = None
    schedule: Schedule = "curriculum"
    horizon: int = 0
    stages: int = 10
    window: int = 100
    tolerance: float = 0.3
    rollout: Rollout = Rollout(steps=65_536, epochs=5, batch_size=1024)
    exploration: Exploration = Exploration(execute=10, noise=0.15, correlation=0.9)
    trial: Trial = Trial(flights=128, every=400_000)
    prior: str | None = None
    cloning: BC = BC(steps=6_000, validation=0.0, field_dropout=0.6)
    patience: float = 2.0
    reward: Source = "sparse"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=50_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

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

    def learn(self, run: OnlineRun) -> None:
        start: Start = run.problem.start
        actor = start.chunk_actor(run, self.exploration)
        agent = AnchoredActorCritic(self, actor, start.prior.config.history * run.sizes[0])
        guide = load_prior(self.guide, run.collector.env.spec, key="guide") if self.guide else start.expert
        assert guide is not None, "checked before the run was opened"
        learner = ChunkPilot(actor, start.prior, run.collector)
        pilot = GuidedPilot(learner, guide, run.collector, self.curriculum(start.demos), run.rng("guide"))
        hand_over = HandOver(run, start.alone, actor.network, self.trial)

        def more(rollout: Decisions) -> dict[str, float]:
            paid = float(rollout.rewards.mean())
            return {"guide/steps": pilot.steps, "guide/stage": pilot.stage, "rollout/reward": paid}

        given = {"warmup": self.warmup, "hand_over": hand_over, "more": more}
        learn_on_policy(run, self, pilot, agent, actor.network, **given)

    def curriculum(self, demos: Sequence[Episode]) -> Curriculum:
        """Return how the guide's part shrinks, from as long as the longest demonstration where none is specified."""
        return Curriculum(
            schedule=self.schedule,
            horizon=self.horizon or max(map(len, demos)),
            stages=self.stages,
            window=self.window,
            tolerance=self.tolerance,
        )

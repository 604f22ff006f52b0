"""Residual reinforcement learning: a small network shifts the actions of a frozen policy.

The base is a policy of any class (``prior=RUN``), chunked ones and those with noise of their own too, or a clone of the
demonstrations. It flies as it would alone; its action, normalised, is shifted by at most ``reach``, by what a network
makes of the observation and of that action. The network's last layer starts at zero, and so does the shift: before
anything is learned the policy is its base. A shift is held for ``hold`` steps, so that noise moves the vehicle and is
not averaged out, and one decision is one action of PPO, credited with all rewards until the next.

Up to ``warmup`` a critic alone learns the value of the base; afterwards the pull to no shift, ``kl``, and the gate of
``bc_ppo`` keep it.

Metrics: those of ``bc_ppo`` without its trial of the clone; ``actor/divergence`` is that from no shift.

Source: T. Johannink et al., "Residual Reinforcement Learning for Robot Control", 2019, equation 2; L. Ankile et al.,
"From Imitation to Refinement", 2024, section 4: PPO beside a frozen policy of chunks, whose action the residual sees.
There a shift lasts one step; holding it, its bound, the pull and the gate are ours.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import AnchoredActorCritic
from aerial_il.algorithms.on_policy.from_clone import FromClone, Start
from aerial_il.algorithms.on_policy.gate import ReturnGate
from aerial_il.algorithms.on_policy.loop import learn_on_policy
from aerial_il.algorithms.on_policy.settings import Rollout, require_deviation
from aerial_il.algorithms.on_policy.shifting import ShiftActor, ShiftPilot
from aerial_il.algorithms.online.problem import Source
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.core.checks import require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.residual import ResidualPolicy, Shift


@dataclass(frozen=True, kw_only=True)
class Residual(FromClone):
    """Residual reinforcement learning around a frozen policy (Johannink et al. 2019, Ankile et al. 2024).

    Attributes:
        lr: the actor's learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
        kl: weight of a decision's KL divergence from no shift; it falls linearly to zero.
        hidden: widths of the network that shifts.
        reach: the largest shift, in standard deviations of the demonstrated actions, or in halves of their range where
            the prior's ``action_scaling`` is ``minmax``.
        hold: steps that a shift lasts.
        noise: standard deviation of the pre-tanh samples at first; it is learned from there on.
    """

    name: ClassVar[str] = "residual"

    steps: int = 4_000_000
    warmup: int = 50_000
    gamma: float = 0.995
    gae_lambda: float = 0.95
    lr: float = 3e-4
    critic_lr: float = 1e-3
    critic_hidden: tuple[int, ...] = (128, 128)
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.05
    kl: float = 0.001
    gate: float = 2.0
    hidden: tuple[int, ...] = (128, 128)
    reach: float = 0.5
    hold: int = 10
    noise: float = 0.3
    rollout: Rollout = Rollout(steps=65_536, epochs=5, batch_size=1024)
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
        require_positive(self, "reach", "hold")
        require_deviation(self.noise)

    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return the prior, which flies as it would alone.

        Raises:
            InvalidValueError: it sees no state field, so that a shift could depend on nothing.
        """
        if not prior.interface.layout.names:
            raise InvalidValueError("The prior sees images alone, and a shift sees state fields: name some, obs_names.")
        return prior

    def learn(self, run: OnlineRun) -> None:
        start: Start = run.problem.start
        base = start.prior
        seen, moved = sum(run.sizes), base.interface.varied & np.isnan(base.interface.switches.low)
        actor = ShiftActor(Shift(seen, self.hidden, moved, self.reach), self.noise)
        agent = AnchoredActorCritic(self, actor, seen)
        pilot = ShiftPilot(actor, base.fresh(), self.hold, run.collector)
        gate = ReturnGate(actor, run.collector.n, self.gate)
        run.wrap = lambda own: ResidualPolicy(
            base.fresh(), actor.shift, hidden=self.hidden, hold=self.hold, origin=own.origin
        )
        learn_on_policy(run, self, pilot, agent, base.network, warmup=self.warmup, gate=gate)

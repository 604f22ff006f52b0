"""Residual reinforcement learning: a small network shifts the actions of a frozen policy.

The base is a policy of any class (``prior=RUN``), chunked ones and those with noise of their own too, or a clone of the
demonstrations. It flies as it would alone; its action, normalised, is shifted by at most ``reach``, by what a network
makes of the observation and of that action. The network's last layer starts at zero, and so does the shift: before
anything is learned the policy is its base. A shift is held for ``hold`` steps, so that noise moves the vehicle and is
not averaged out, and one decision is one action of PPO, credited with all rewards until the next.

Up to ``warmup`` a critic alone learns the value of the base; afterwards the pull to no shift, ``kl``, and the gate of
``bc_ppo`` keep it.

Metrics: those of ``bc_ppo``; ``actor/divergence`` is that from no shift.

Source: T. Johannink et al., "Residual Reinforcement Learning for Robot Control", 2019, equation 2; L. Ankile et al.,
"From Imitation to Refinement", 2024, section 4: PPO beside a frozen policy of chunks, whose action the residual sees.
There a shift lasts one step; holding it, its bound, the pull and the gate are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.bc_ppo import AnchoredActorCritic
from aerial_il.algorithms.decisions.gate import ReturnGate
from aerial_il.algorithms.decisions.practice import GatedOnPolicy, Practice, PractisedPolicy
from aerial_il.algorithms.decisions.rollout import collect_decisions, judged
from aerial_il.algorithms.decisions.shifting import ShiftActor, ShiftPilot
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_positive, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.residual import ResidualPolicy, Shift


@dataclass(frozen=True, kw_only=True)
class Residual(PractisedPolicy, GatedOnPolicy):
    """Settings of a run, beside those of :class:`PractisedPolicy` and :class:`GatedOnPolicy`.

    Attributes:
        hidden: widths of the network that shifts.
        reach: the largest shift, in standard deviations of the demonstrated actions, or in halves of their range where
            the prior's ``action_scaling`` is ``minmax``.
        hold: steps that a shift lasts.
        noise: standard deviation of the pre-tanh samples at first; it is learned from there on.
    """

    name: ClassVar[str] = "residual"

    steps: int = 16_000_000
    gamma: float = 0.995
    lr: float = 3e-4
    clip: float = 0.2
    target_kl: float = 0.05
    hidden: tuple[int, ...] = (128, 128)
    reach: float = 0.5
    hold: int = 10
    noise: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "reach", "hold", "noise")
        require_widths(self, "hidden")

    def flown(self, prior: ChunkPolicy) -> ChunkPolicy:
        """Return the prior, which flies as it would alone.

        Raises:
            InvalidValueError: it sees no state field, so that a shift could depend on nothing.
        """
        if not prior.interface.layout.names:
            raise InvalidValueError("The prior sees images alone, and a shift sees state fields: name some, obs_names.")
        return prior

    def practise(self, practice: Practice) -> ChunkPolicy:
        run, base = practice.run, practice.prior
        seen, moved = sum(run.sizes), base.interface.varied & np.isnan(base.interface.switches.low)
        actor = ShiftActor(Shift(seen, self.hidden, moved, self.reach), self.noise)
        agent = AnchoredActorCritic(self, actor, seen, smoothness=self.smoothness)
        pilot = ShiftPilot(actor, base.fresh(), self.hold, run.collector)
        gate, reward_norm = ReturnGate(actor, run.collector.n, self.gate), RewardNorm(run.collector.n, self.gamma)
        run.wrap = lambda own: ResidualPolicy(
            base.fresh(), actor.shift, hidden=self.hidden, hold=self.hold, origin=own.origin
        )
        run.begin(base.network, {"agent": agent, "pilot": pilot, "gate": gate, "reward_norm": reward_norm})

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            decisions = collect_decisions(run.collector, pilot, self.rollout)
            improve = gate.passes(decisions, warming_up=warming_up)
            rewards = reward_norm.scale(decisions.rewards, decisions.ended)
            found = judged(decisions, agent.values, rewards, gamma=self.gamma, gae_lambda=self.gae_lambda)
            run.log(agent.learn(found.data, left=run.left, improve=improve))
            run.log({"critic/value": found.value, "actor/fallbacks": float(not (improve or warming_up))})
            run.end_turn()

        return run.finish()

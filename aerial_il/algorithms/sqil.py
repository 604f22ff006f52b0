"""Soft Q imitation learning: the demonstrator's transitions have reward 1, the agent's 0; no reward is learned.

A soft actor-critic (:mod:`aerial_il.algorithms.sac`, whose losses these are) on minibatches of which one half are
demonstrations. To be rewarded, the agent must go where demonstrations go and return there when it has strayed. Nothing
adversarial, hence hard to break and quick; yet the rewards never change, so an agent that imitates well still receives
0, and long training can drift away again.

``control`` runs the same without a demonstration, see :mod:`aerial_il.algorithms.dac`; ``constant_reward`` rewards
every step before an end with 1.

Metrics: those of ``sac``; ``episode/return`` is the environment's own, which the agent never sees.

Source: S. Reddy, A. Dragan, S. Levine, "SQIL: Imitation Learning via Reinforcement Learning with Sparse Rewards", 2020.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, concatenated
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.imitation import Imitation
from aerial_il.algorithms.rl.off_policy import SoftOffPolicy, collect_step
from aerial_il.algorithms.sac import SoftActorCritic
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class SQIL(Imitation, SoftOffPolicy):
    """Settings of a run; see :class:`Imitation` and :class:`SoftOffPolicy`."""

    name: ClassVar[str] = "sqil"

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = SoftActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        blind = RandomActions(run.sizes[1], run.rng("warm-up"))
        expert_buffer = run.demos.buffer(run.interface, run.rng("expert"), absorbing=self.absorbing, reward=1.0)
        buffer = ReplayBuffer(self.buffer_size, *run.sizes, run.rng("minibatches"))
        parts = {"agent": agent, "expert_buffer": expert_buffer, "replay_buffer": buffer, "random_actions": blind}
        run.begin(agent.actor, parts)

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            step = collect_step(run.collector, run.interface, blind if warming_up else agent)
            step = step._replace(rewards=np.zeros(run.collector.n))
            buffer.add(step.rows(absorbing=self.absorbing))

            agent.set_lr(self.lr_at(run.left))
            for _ in range(0 if warming_up else run.updates_due(self.utd_ratio)):
                run.log(agent.update(self._minibatch(expert_buffer, buffer)))
            run.end_turn()

        return run.finish()

    def _minibatch(self, expert_buffer: ReplayBuffer, buffer: ReplayBuffer) -> Batch:
        """Return demonstrations and the agent's transitions, half of each; in the control run, rewarded for living."""
        if self.control == "constant_reward":
            batch = buffer.sample(self.batch_size)
            return batch._replace(rewards=1.0 - batch.obs[:, -1])
        half = self.batch_size // 2
        return concatenated(expert_buffer.sample(half), buffer.sample(self.batch_size - half))

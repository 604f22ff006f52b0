"""Deep Q-network (DQN): the worth of each of a few choices, learned from a replay buffer; the best one is taken.

Each turn takes one step in every world, with probability epsilon a random choice, else the one of the highest value,
and keeps it. Every ``update_every`` environment steps it takes ``utd_ratio`` gradient steps for each of them towards

    ``Q(s, a) = r + gamma * Q'(s', argmax Q(s', .))``,

Q' following Q every ``target_every`` updates by the share ``tau``. Where ``double`` is off, Q' itself chooses, and
overrates. Values are the scores of a ``categorical``; ``policy.dueling=true`` learns the worth of states apart.

Metrics: ``critic/loss``, ``critic/value``, ``actor/epsilon``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: V. Mnih et al., "Human-level Control through Deep Reinforcement Learning", 2015; H. van Hasselt et al., "Deep
Reinforcement Learning with Double Q-learning", 2016, equation 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from aerial_il.algorithms.rl.agent import Agent
from aerial_il.algorithms.rl.critics import Target
from aerial_il.algorithms.rl.off_policy import OffPolicy
from aerial_il.algorithms.rl.online_run import OnlineRun
from aerial_il.algorithms.rl.reinforcement import OffPolicyReinforcement
from aerial_il.algorithms.rl.replay.experience_replay import ExperienceReplay
from aerial_il.algorithms.rl.replay.replay_buffer import Batch
from aerial_il.algorithms.run.checks import require_positive, require_share
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical, CategoricalConfig
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class DeepQLearning(OffPolicyReinforcement, OffPolicy):
    """Settings of a run, beside those of :class:`OffPolicyReinforcement` and :class:`OffPolicy`.

    Attributes:
        double: let Q choose what Q' judges.
        epsilon: probability of a random choice, once it has fallen; it begins at 1.
        exploration: share of all steps over which it falls, evenly.
        update_every: environment steps from one bout of updates to the next. In between the policy stays as it is, so
            that it presses on in one direction even where all choices seem to be worth the same.
        target_every: updates between two at which Q' follows. clip_norm: largest gradient norm.
        huber: error beyond which the loss grows linearly. Where it is small against the values, a rare end that
            costs all that was still to come hardly teaches more than any other step.
    """

    name: ClassVar[str] = "dqn"
    trains: ClassVar[tuple[type[PolicyConfig], ...]] = (CategoricalConfig,)

    lr: float = 1e-3
    tau: float = 1.0
    double: bool = True
    epsilon: float = 0.05
    exploration: float = 0.1
    update_every: int = 1
    target_every: int = 500
    clip_norm: float = 10.0
    huber: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "epsilon", "exploration")
        require_positive(self, "update_every", "target_every", "clip_norm", "huber")

    def epsilon_at(self, left: float) -> float:
        """Return the probability of a random choice when the share ``left`` of the training is left."""
        fallen = min(1.0, (1.0 - left) / self.exploration) if self.exploration else 1.0
        return 1.0 + fallen * (self.epsilon - 1.0)

    def updates_due(self, steps: int, worlds: int) -> int:
        """Return how many updates follow a turn of one step in each of ``worlds``, after which ``steps`` are done."""
        due, done = (int(self.utd_ratio * (n - n % self.update_every)) for n in (steps, steps - worlds))
        return due - done

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = DeepQAgent(self, run.build_actor(Categorical))
        replay = ExperienceReplay(self, run, self.buffer_size)
        run.begin(agent.network, {"agent": agent, **replay.parts})

        while run.goes_on():
            agent.epsilon = self.epsilon_at(run.left)
            replay.step(agent)
            warming_up = run.collector.steps <= self.warmup
            if not warming_up:
                replay.finish_warmup()

            agent.set_lr(self.lr_at(run.left))
            for _ in range(0 if warming_up else self.updates_due(run.collector.steps, run.collector.n)):
                run.log({**agent.update(replay.sample(self.batch_size)), "actor/epsilon": agent.epsilon})
            run.end_turn()

        return run.finish()


class DeepQAgent(Agent):
    """The values of all choices, and their target.

    Args:
        settings: of the algorithm.
        network: the policy's.

    Attributes:
        epsilon: probability of a random choice.
    """

    def __init__(self, settings: DeepQLearning, network: Categorical) -> None:
        self.settings, self.network, self.epsilon = settings, network, 1.0
        self._values = TrainState(network, adam(network, settings.lr))
        self._target = Target(network)
        super().__init__({"values": self._values}, {"target": self._target})

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return normalised actions (n, Da) for encoded observations (n, Do): the best choices, or random ones."""
        best = self.network.scores(tensor(obs)[:, None])[:, 0].argmax(-1)
        random = torch.randint(len(self.network.table), best.shape)
        return self.network.table[torch.where(torch.rand(best.shape) < self.epsilon, random, best)].numpy()

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of the values, and let the target follow where it is due."""
        chosen = self.network.nearest(batch.actions)
        values = self.network.scores(batch.obs[:, None, :-1])[:, 0].gather(-1, chosen[:, None])[:, 0]
        loss = huber_loss(values, self.bellman_targets(batch), delta=self.settings.huber)
        self._values.descend(loss, clip_norm=self.settings.clip_norm)
        self.updates += 1
        if self.updates % self.settings.target_every == 0:
            self._target.follow(self.settings.tau)
        return {"critic/loss": loss.item(), "critic/value": values.mean().item()}

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * Q'(s', a')`` (B,), a' the best choice by Q, or by Q' itself."""
        after = batch.next_obs[:, None, :-1]
        values = self._target.network.scores(after)[:, 0]
        choosing = self.network.scores(after)[:, 0] if self.settings.double else values
        worth = values.gather(-1, choosing.argmax(-1, keepdim=True))[:, 0]
        return batch.rewards + self.settings.gamma * batch.continues * worth

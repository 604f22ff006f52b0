"""Deep Q-network (DQN): the values of discrete actions, learned from a replay buffer; the greedy action is taken.

Each turn takes one step in every world, with probability epsilon a random action, else the greedy one, and stores it. A
random action may be held for some steps (``longest_hold``), so that it leads away from where greedy actions stay. Every
``update_every`` environment steps it takes ``utd_ratio`` gradient steps for each of them towards

    ``Q(s, a) = r + gamma * Q'(s', argmax Q(s', .))``,

with a target network Q', which follows Q every ``target_every`` updates by the share ``tau``. Where ``double`` is off,
Q' itself selects the action, and overestimates. Values are the scores of a ``categorical``; ``policy.dueling=true``
learns the value of states separately.

Metrics: ``critic/loss``, ``critic/value``, ``actor/epsilon``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: V. Mnih et al., "Human-level Control through Deep Reinforcement Learning", 2015; H. van Hasselt et al., "Deep
Reinforcement Learning with Double Q-learning", 2016, equation 4; for random actions that are held, W. Dabney,
G. Ostrovski, A. Barreto, "Temporally-Extended epsilon-Greedy Exploration", 2021, appendix B.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.target import Target
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.off_policy import OffPolicy
from aerial_il.algorithms.rl.reinforcement import OffPolicyReinforcement
from aerial_il.algorithms.run.checks import require_positive, require_share
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical, CategoricalNetwork
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings


@dataclass(frozen=True, kw_only=True)
class DQN(OffPolicyReinforcement, OffPolicy):
    """Settings of a run, beside those of :class:`OffPolicyReinforcement` and :class:`OffPolicy`.

    Attributes:
        double: let Q select the action that Q' evaluates.
        epsilon: probability of a random action, once it has fallen; it starts at 1.
        longest_hold: steps that a random action is held for, at most; n of them with a probability that falls as
            1 / n^2. At 1 each step is sampled by itself.
        exploration: share of all steps over which it falls, linearly.
        update_every: environment steps from one block of updates to the next. In between the policy stays as it is, so
            that it presses on in one direction even where all actions seem to have the same value.
        target_every: updates between two at which Q' follows. clip_norm: largest gradient norm.
        huber: error beyond which the loss grows linearly. Where it is small against the values, a rare end that
            forfeits all future rewards hardly teaches more than any other step.
    """

    name: ClassVar[str] = "dqn"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (Categorical,)

    lr: float = 1e-3
    tau: float = 1.0
    double: bool = True
    epsilon: float = 0.05
    longest_hold: int = 1
    exploration: float = 0.1
    update_every: int = 1
    target_every: int = 500
    clip_norm: float = 10.0
    huber: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "epsilon", "exploration")
        require_positive(self, "longest_hold", "update_every", "target_every", "clip_norm", "huber")
        self.smoothness.check_for_choices()

    def epsilon_at(self, left: float) -> float:
        """Return the probability of a random action when the share ``left`` of the training is left."""
        fallen = min(1.0, (1.0 - left) / self.exploration) if self.exploration else 1.0
        return 1.0 + fallen * (self.epsilon - 1.0)

    def updates_due(self, steps: int, worlds: int) -> int:
        """Return how many updates follow a turn of one step in each of ``worlds``, after which ``steps`` are done."""
        due, done = (int(self.utd_ratio * (n - n % self.update_every)) for n in (steps, steps - worlds))
        return due - done

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = DeepQAgent(self, run.build_actor(CategoricalNetwork))
        replay = ExperienceReplay(run, self.buffer_size, hindsight=self.hindsight, obs_norm=self.obs_norm)
        run.begin(agent.network, {"agent": agent, **replay.parts})

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            agent.epsilon = self.epsilon_at(run.left)
            replay.step(agent)
            if not warming_up:
                replay.finish_warmup()

            agent.set_lr(self.lr_at(run.left))
            for _ in range(0 if warming_up else self.updates_due(run.collector.steps, run.collector.n)):
                run.log({**agent.update(replay.sample(self.batch_size)), "actor/epsilon": agent.epsilon})
            run.end_turn()

        return run.finish()


class DeepQAgent(Agent):
    """The values of all actions, and their target network.

    Args:
        settings: of the algorithm.
        network: the policy's.

    Attributes:
        epsilon: probability of a random action.
    """

    def __init__(self, settings: DQN, network: CategoricalNetwork) -> None:
        self.settings, self.network, self.epsilon = settings, network, 1.0
        self._values = TrainState(network, adam(network, settings.lr))
        self._target, self._held = Target(network), HeldChoices(len(network.table), settings.longest_hold)
        super().__init__({"values": self._values}, {"target": self._target}, {"held": self._held})

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return normalised actions (n, Da) for encoded observations (n, Do): the greedy ones, or random ones."""
        best = self.network.scores(tensor(obs)[:, None])[:, 0].argmax(-1)
        return self.network.table[self._held.instead_of(best, self.epsilon)].numpy()

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of the values, and let the target network follow where it is due."""
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
        """Return ``r + gamma * Q'(s', a')`` (B,), a' the greedy action by Q, or by Q' itself."""
        after = batch.next_obs[:, None, :-1]
        values = self._target.network.scores(after)[:, 0]
        choosing = self.network.scores(after)[:, 0] if self.settings.double else values
        worth = values.gather(-1, choosing.argmax(-1, keepdim=True))[:, 0]
        return batch.rewards + self.settings.gamma * batch.continues * worth


class HeldChoices:
    """Random actions taken now and then in each world, each held for some steps.

    Args:
        choices: number of discrete actions. longest: steps that one is held for, at most.
    """

    def __init__(self, choices: int, longest: int) -> None:
        self._choices, self._chance = choices, 1.0 / torch.arange(1, longest + 1) ** 2
        self._chosen = self._left = torch.zeros(0, dtype=torch.long)

    def instead_of(self, best: Tensor, epsilon: float) -> Tensor:
        """Return actions (n,): ``best`` (n,), unless a random one is held or, with probability ``epsilon``, sampled."""
        if len(self._left) == 0:
            self._chosen = self._left = torch.zeros_like(best)
        drawn = (self._left == 0) & (torch.rand(best.shape) < epsilon)
        self._chosen = torch.where(drawn, torch.randint(self._choices, best.shape), self._chosen)
        steps = 1 + torch.multinomial(self._chance, len(best), replacement=True)
        self._left = torch.where(drawn, steps, self._left)
        found = torch.where(self._left > 0, self._chosen, best)
        self._left = (self._left - 1).clamp(min=0)
        return found

    def snapshot(self) -> Snapshot:
        return Snapshot({"chosen": self._chosen.numpy().copy(), "left": self._left.numpy().copy()})

    def restore(self, saved: Snapshot) -> None:
        self._chosen, self._left = (torch.from_numpy(saved.arrays[name].copy()) for name in ("chosen", "left"))

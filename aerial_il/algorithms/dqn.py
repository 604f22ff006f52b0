"""Deep Q-network (DQN): the values of discrete actions, learned from a replay buffer; the greedy action is taken.

Each turn takes one step in every world, with probability epsilon a random action, else the greedy one, and stores it. A
random action may be held for some steps (``longest_hold``), so that it leads away from where greedy actions stay. Every
``update_every`` environment steps it takes ``replay.updates_per_step`` gradient steps for each of them towards

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

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import from_reward_or_prior
from aerial_il.algorithms.off_policy.settings import Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import Follower, TrainState, adam
from aerial_il.core.checks import require_positive, require_share
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical, CategoricalNetwork
from aerial_il.policies.parts.network import PolicySettings


@dataclass(frozen=True, kw_only=True)
class DQN(Algorithm):
    """Deep Q-network (Mnih et al. 2015), by default a double one (van Hasselt et al. 2016).

    Attributes:
        warmup: the first of those steps, flown with mostly random actions before anything is learned.
        tau: share by which the target network follows.
        target_every: updates between two at which it does.
        double: let Q select the action that Q' evaluates.
        epsilon: probability of a random action, once it has fallen; it starts at 1.
        longest_hold: steps that a random action is held for, at most; n of them with a probability that falls as
            1 / n^2. At 1 each step is sampled by itself.
        exploration: share of all steps over which it falls, linearly.
        update_every: environment steps from one block of updates to the next. In between the policy stays as it is, so
            that it presses on in one direction even where all actions seem to have the same value.
        huber: error beyond which the loss grows linearly. Where it is small against the values, a rare end that
            forfeits all future rewards hardly teaches more than any other step.
    """

    name: ClassVar[str] = "dqn"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (Categorical,)

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 1e-3
    lr_floor: float = 1.0
    tau: float = 1.0
    target_every: int = 500
    double: bool = True
    epsilon: float = 0.05
    longest_hold: int = 1
    exploration: float = 0.1
    update_every: int = 1
    clip_norm: float = 10.0
    huber: float = 1.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    reward: Source = "environment"
    reward_patience: int = 200_000
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    obs_norm: bool = False
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "epsilon", "exploration")
        require_share(self, "tau")
        require_positive(self, "tau", "longest_hold", "update_every", "target_every", "huber")
        self.smoothness.check_for_choices()

    def epsilon_at(self, left: float) -> float:
        """Return the probability of a random action when the share ``left`` of the training is left."""
        fallen = min(1.0, (1.0 - left) / self.exploration) if self.exploration else 1.0
        return 1.0 + fallen * (self.epsilon - 1.0)

    def problem(self, given: Given) -> Problem:
        return from_reward_or_prior(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = DeepQAgent(self, run.build_actor(CategoricalNetwork), lambda: self.epsilon_at(run.left))
        flights = ExperienceReplay(run, self.replay.capacity, hindsight=self.hindsight, obs_norm=self.obs_norm)

        def update(improve: bool) -> dict[str, float]:
            del improve  # nothing is learned in the warm-up
            return {**agent.update(flights.buffer.sample(self.replay.batch_size)), "actor/epsilon": agent.epsilon}

        learn_off_policy(run, self, agent, flights, update, pilot=agent, every=self.update_every)


class DeepQAgent(Agent[CategoricalNetwork]):
    """The values of all actions, and their target network.

    Args:
        settings: of the algorithm.
        actor: the policy's network.
        falling: returns the probability of a random action as it stands.

    Attributes:
        epsilon: that probability at the last step.
    """

    changing = ("values", "target", "_held", "updates")

    def __init__(self, settings: DQN, actor: CategoricalNetwork, falling: Callable[[], float] = lambda: 1.0) -> None:
        self.settings, self.actor, self.epsilon, self._falling = settings, actor, 1.0, falling
        self.values, self.target = TrainState(actor, adam(actor, settings.lr)), Follower(actor)
        self._held, self.updates = HeldChoices(len(actor.table), settings.longest_hold), 0

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return normalised actions (n, Da) for encoded observations (n, Do): the greedy ones, or random ones."""
        self.epsilon = self._falling()
        best = self.actor.scores(tensor(obs)[:, None])[:, 0].argmax(-1)
        return self.actor.table[self._held.instead_of(best, self.epsilon)].numpy()

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of the values, and let the target network follow where it is due."""
        chosen = self.actor.nearest(batch.actions)
        values = self.actor.scores(batch.obs[:, None, :-1])[:, 0].gather(-1, chosen[:, None])[:, 0]
        loss = huber_loss(values, self.bellman_targets(batch), delta=self.settings.huber)
        self.values.descend(loss, clip_norm=self.settings.clip_norm)
        self.updates += 1
        if self.updates % self.settings.target_every == 0:
            self.target.follow(self.settings.tau)
        return {"critic/loss": loss.item(), "critic/value": values.mean().item()}

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * Q'(s', a')`` (B,), a' the greedy action by Q, or by Q' itself."""
        after = batch.next_obs[:, None, :-1]
        values = self.target.network.scores(after)[:, 0]
        choosing = self.actor.scores(after)[:, 0] if self.settings.double else values
        chosen = values.gather(-1, choosing.argmax(-1, keepdim=True))[:, 0]
        return batch.rewards + self.settings.gamma * batch.continues * chosen


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
        actions = torch.where(self._left > 0, self._chosen, best)
        self._left = (self._left - 1).clamp(min=0)
        return actions

    def snapshot(self) -> Snapshot:
        return Snapshot({"chosen": self._chosen.numpy().copy(), "left": self._left.numpy().copy()})

    def restore(self, saved: Snapshot) -> None:
        self._chosen, self._left = (torch.from_numpy(saved.arrays[name].copy()) for name in ("chosen", "left"))

"""Twin delayed deep deterministic policy gradient (TD3): a deterministic actor, and two critics against overestimation.

Each turn takes one step in every world with the actor's action and Gaussian noise on it, stores it, and takes
``replay.updates_per_step`` gradient steps for each environment step on minibatches of the buffer. Two critics learn

    ``Q(s, a) = r + gamma * min Q'(s', a')``,    a' = clip(mu'(s') + clip(eps, -c, c), -1, 1),    eps ~ N(0, sigma'),

with slowly following target networks Q' and mu': the smaller of two estimates (clipped double Q-learning), for actions
around the target's, so that no narrow peak of an error is exploited (target policy smoothing). The actor mu ascends the
first critic at every ``actor_every``-th step, when the critics have settled a little (delayed policy updates). It is
the mean action of a ``squashed_gaussian``, whose standard deviation is not used.

Metrics: ``critic/loss``, ``critic/value``, ``actor/loss``; ``episode/return``, ``episode/length``, ``episode/success``
of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: S. Fujimoto et al., "Addressing Function Approximation Error in Actor-Critic Methods", 2018, algorithm 1;
defaults are those of its authors' code, but for the warm-up, there 25,000 steps.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from aerial_il.algorithms.ddpg import DeterministicAgent
from aerial_il.algorithms.off_policy.loop import learn_from_reward
from aerial_il.algorithms.off_policy.problems import from_reward_or_prior
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class TD3(Algorithm):
    """Twin delayed deep deterministic policy gradient (Fujimoto et al. 2018, algorithm 1).

    Attributes:
        actor_every: how many of the critics' gradient steps for each one of the actor and of the targets.
    """

    name: ClassVar[str] = "td3"

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 2
    noise: float = 0.1
    noise_correlation: float = 0.0
    target_noise: float = 0.2
    noise_clip: float = 0.5
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    reward: Source = "environment"
    reward_patience: int = 200_000
    prior: str | None = None
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    obs_norm: bool = False
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        return from_reward_or_prior(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = TwinDelayedAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_from_reward(run, self, agent, agent.update)


class TwinDelayedAgent(DeterministicAgent):
    """The agent of ``ddpg`` with two critics, and with targets that follow where the actor's step is due."""

    def update(self, batch: Batch, *, improve: bool = True) -> dict[str, float]:
        """Take one step of the critics and, where it is due, of all targets and, to ``improve``, of the actor."""
        critic_loss, metrics = self.critic_loss(batch)
        self.critics.descend(critic_loss)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            if improve:
                actor_loss = self.actor_loss(batch)
                self.actor_state.descend(actor_loss)
                metrics["actor/loss"] = actor_loss.item()
            for target in (self.actor_target, self.targets):
                target.follow(self.settings.critics.tau)
        return metrics

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * min Q'(s', a')`` (B,), with actions a' sampled around the target's."""
        actions = self.actor_target.network(batch.next_obs[:, None, :-1])[:, 0]
        noise = self.settings.target_noise * torch.randn_like(actions)
        limit = self.settings.noise_clip
        actions = (actions + noise.clamp(-limit, limit)).clamp(-1, 1)
        values = self.targets.network(batch.next_obs, actions).min(0).values
        return batch.rewards + self.settings.gamma * batch.continues * values

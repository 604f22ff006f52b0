"""TD3 with behavioural cloning (TD3+BC): the actor climbs its critic, and stays near the actions that were taken.

The actor of ``td3`` descends, on a dataset first and then on its flights alike,

    ``-lambda mean Q1(s, mu(s)) + mean |mu(s) - a|^2 / Da``,    lambda = alpha / mean |Q1(s, mu(s))|,

and all else is as there. Observations are standardised by the demonstrations.

Source: S. Fujimoto, S. Gu, "A Minimalist Approach to Offline Reinforcement Learning", 2021, equation 5.
"""

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from aerial_il.algorithms.off_policy.loop import learn_offline_first
from aerial_il.algorithms.off_policy.problems import from_demonstrations
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.td3 import TwinDelayedAgent
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class TD3BC(Algorithm):
    """TD3 with behavioural cloning (Fujimoto and Gu 2021).

    Attributes:
        alpha: weight of the value beside the distance from the actions that were taken.
    """

    name: ClassVar[str] = "td3_bc"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    offline_steps: int = 50_000
    warmup: int = 1_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 2
    alpha: float = 2.5
    noise: float = 0.1
    noise_correlation: float = 0.0
    target_noise: float = 0.2
    noise_clip: float = 0.5
    demos_share: float = 0.5
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=False, control="none"
    )
    failures: bool = False
    reward: Source = "environment"
    reward_patience: int = 200_000
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = CloningAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_offline_first(run, self, agent, agent.update)


class CloningAgent(TwinDelayedAgent):
    """The agent of ``td3``, whose actor is held near the actions of the minibatch."""

    def actor_loss(self, batch: Batch) -> Tensor:
        """Return ``-lambda mean Q1(s, mu(s)) + mean |mu(s) - a|^2 / Da``, plus the smoothness loss."""
        obs = batch.obs[:, :-1]
        actions = self.actor(obs[:, None])[:, 0]
        values = self.critics.network(batch.obs, actions)[0]
        weight = self.settings.alpha / values.abs().mean().detach().clamp(min=1e-6)
        near = ((actions - batch.actions) ** 2).mean()
        return near - weight * values.mean() + self.settings.smoothness.loss(self.actor, obs, batch.next_obs[:, :-1])

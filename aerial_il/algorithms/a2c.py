"""Advantage actor-critic (A2C): a few steps of every world, one step of actor and critic, and on.

Each turn collects ``rollout.steps`` steps, estimates generalised advantages A (with ``gae_lambda`` 1 the discounted
rewards to the rollout's end and the critic's estimate there, less the estimate at the step), and takes one step to
minimise

    ``-E[A log pi(a | s)] - entropy * H(pi)``    and    ``E[(V(s) - R)^2]``.

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns;
where an episode was only cut by its time limit, its return bootstraps from the critic.

Metrics: ``actor/loss``, ``actor/entropy``, ``critic/loss``, ``critic/value``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: V. Mnih et al., "Asynchronous Methods for Deep Reinforcement Learning", 2016, algorithm S3, its workers
synchronous and its optimiser Adam.
"""

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.on_policy.actor_critic import ActorCritic
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.loop import check_rollout, learn_step_by_step
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source, from_reward
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class A2C(Algorithm):
    """Advantage actor-critic (Mnih et al. 2016, algorithm S3).

    Attributes:
        lr: learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
        clip_norm: largest gradient norm of the actor.
        rollout: epochs and batch_size are the critic's; the actor takes one step.
    """

    name: ClassVar[str] = "a2c"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    steps: int = 300_000
    gamma: float = 0.99
    gae_lambda: float = 1.0
    lr: float = 7e-4
    entropy: float = 0.0
    clip_norm: float = 0.5
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=64, epochs=1, batch_size=None)
    reward: Source = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        check_rollout(self, given.env)
        return from_reward(self, given)

    def learn(self, run: OnlineRun) -> None:
        learn_step_by_step(run, self, AdvantageAgent)


class AdvantageAgent(ActorCritic[StochasticNetwork]):
    """An actor that takes one step for each rollout, and the critic that estimates advantages."""

    changing = ("_actor", "_critic")

    def __init__(self, settings: A2C, actor: StochasticNetwork, obs_size: int) -> None:
        super().__init__(settings, actor, obs_size)
        self._actor = TrainState(actor, adam(actor, settings.lr))

    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> dict[str, float]:
        """Learn from one rollout, when the share ``left`` of the training is left."""
        for part in (self._actor, self._critic):
            part.set_lr(self.settings.lr * left)
        metrics = self.improve(judged.data) if improve else {}
        return {**metrics, "critic/loss": self._critic.fit(judged.data, self.settings.rollout)}

    def improve(self, data: Advantages) -> dict[str, float]:
        """Take one step of the actor."""
        settings = self.settings
        log_prob, entropy = self.actor.judge(data.obs[:, None], data.raw)
        loss = -(data.advantages * log_prob).mean() - settings.entropy * entropy.mean()
        loss = loss + settings.smoothness.loss(self.actor, data.obs, data.next_obs)
        self._actor.descend(loss, clip_norm=settings.clip_norm)
        return {"actor/loss": loss.item(), "actor/entropy": entropy.mean().item()}

"""REINFORCE with a baseline: the return that follows an action makes it more likely, or less likely.

Each turn collects ``rollout.steps`` steps or a few more, cutting episodes that are in progress, and takes one step up

    ``E[(G_t - V(s_t)) grad log pi(a_t | s_t)]``,    G_t = sum over k of gamma^k r_{t+k} to the episode's end,

where the baseline V, learned after the step, adds no bias and reduces the variance. Where an episode was only cut, by
its time limit or by the rollout's end, G_t bootstraps from the baseline there; what the rollout's end cut goes on in
the next turn.

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns,
and advantages standardised over the rollout.

Metrics: ``actor/loss``, ``actor/entropy``, ``critic/loss``, ``critic/value``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: R. Williams, "Simple Statistical Gradient-Following Algorithms for Connectionist Reinforcement Learning", 1992;
R. Sutton, A. Barto, "Reinforcement Learning: An Introduction", 2018, section 13.4.
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
class REINFORCE(Algorithm):
    """REINFORCE with a baseline (Williams 1992).

    Attributes:
        lr: learning rate at the start; the actor's falls linearly to zero.
        gae_lambda: 1 for Monte Carlo returns, and the baseline where an episode was cut.
        rollout: epochs and batch_size are the baseline's; the actor takes one step.
    """

    name: ClassVar[str] = "reinforce"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    steps: int = 300_000
    gamma: float = 0.99
    gae_lambda: float = 1.0
    lr: float = 3e-3
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=2048, epochs=5, batch_size=64)
    reward: Source = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        check_rollout(self, given.env)
        return from_reward(self, given)

    def learn(self, run: OnlineRun) -> None:
        learn_step_by_step(run, self, ReinforceAgent)


class ReinforceAgent(ActorCritic[StochasticNetwork]):
    """An actor, and its baseline."""

    changing = ("_actor", "_critic")

    def __init__(self, settings: REINFORCE, actor: StochasticNetwork, obs_size: int) -> None:
        super().__init__(settings, actor, obs_size)
        self._actor = TrainState(actor, adam(actor, settings.lr))

    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> dict[str, float]:
        """Learn from one rollout, when the share ``left`` of the training is left."""
        self._actor.set_lr(self.settings.lr * left)
        metrics = self.improve(judged.data) if improve else {}
        return {**metrics, "critic/loss": self._critic.fit(judged.data, self.settings.rollout)}

    def improve(self, data: Advantages) -> dict[str, float]:
        """Take one step of the actor."""
        log_prob, entropy = self.actor.judge(data.obs[:, None], data.raw)
        loss = -(data.standardised * log_prob).mean()
        loss = loss + self.settings.smoothness.loss(self.actor, data.obs, data.next_obs)
        self._actor.descend(loss)
        return {"actor/loss": loss.item(), "actor/entropy": entropy.mean().item()}

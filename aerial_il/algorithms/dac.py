"""Discriminator-actor-critic: adversarial imitation that learns off-policy, from a replay buffer.

A discriminator D tells the demonstrator's transitions from the agent's, half of either in each minibatch, by the loss

    ``-log D(s, a)`` of the demonstrator's ``- log(1 - D(s, a))`` of the agent's  ``+ lambda (|grad| - 1)^2``,

held back by that gradient penalty, spectral normalisation or dropout. Its output is the reward of a soft actor-critic
(:mod:`aerial_il.algorithms.sac`), recomputed for each minibatch, so that old transitions have the newest reward.
Terminal steps lead to an absorbing state with a reward of its own
(:mod:`aerial_il.algorithms.online.replay_buffer`).

``control`` runs the same without a demonstration: ``random_actions`` puts flights of random actions in their place,
``constant_reward`` rewards every step before an end with 1, without a discriminator. Whatever such a run reaches,
demonstrations did not cause.

Metrics: those of ``sac``; ``reward/loss``, ``reward/acc_expert``, ``reward/acc_agent`` (accuracies),
``reward/gradient_penalty``, ``reward/mean``. ``episode/return`` is the environment's own, which the agent never sees.

Source: I. Kostrikov et al., "Discriminator-Actor-Critic: Addressing Sample Inefficiency and Reward Bias in Adversarial
Imitation Learning", 2019; the discriminator's defaults after M. Orsini et al., "What Matters for Adversarial Imitation
Learning?", 2021. That it starts from a clone, stays near it and learns at a falling rate is ours:
``docs/adversarial.md`` says what each contributes.
"""

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.adversarial.reward_net import (
    LearnedReward,
    RewardNet,
    starts_cloned,
)
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import check_warmup
from aerial_il.algorithms.off_policy.settings import Critics, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, from_demonstrations
from aerial_il.algorithms.online.replay_buffer import Batch, alive, mixed
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.sac import SoftActorCritic
from aerial_il.core.checks import require_integer, require_share
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class DAC(Algorithm):
    """Discriminator-actor-critic (Kostrikov et al. 2019).

    Attributes:
        bc_pretrain_steps: minibatches of behavioural cloning before the first flight. Afterwards the clone acts in
            place of random actions, and until ``warmup`` critics and discriminator alone learn from it.
        expert_share: share of demonstrated transitions in the agent's minibatches, rewarded like all others.
        reward: the discriminator; its updates are those for each of the critics'.
    """

    name: ClassVar[str] = "dac"
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 0.0
    actor_every: int = 2
    alpha: float = 0.1
    entropy: float = -1.0
    bc_pretrain_steps: int = 5_000
    bc_weight: float = 30.0
    expert_share: float = 0.0
    reward: LearnedReward = LearnedReward(
        form="airl",
        hidden=(128, 128),
        lr=3e-4,
        updates=0.5,
        gradient_penalty=10.0,
        spectral_norm=False,
        dropout=0.0,
        action_noise=True,
    )
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "expert_share")
        require_integer("replay.batch_size", self.replay.batch_size, 2)  # half of it is demonstrated

    def problem(self, given: Given) -> Problem:
        if not starts_cloned(self):
            check_warmup(self, given.env)
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        absorbing, size = self.demonstrations.absorbing, self.replay.batch_size
        agent = SoftActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        reward_net = RewardNet(*run.sizes, self.reward.shape(running_norm=False), lr=self.reward.lr)
        demos = run.demos.buffer(run.interface, run.rng("expert"), absorbing=absorbing)
        flights = ExperienceReplay(run, self.replay.capacity, absorbing=absorbing, rewarded=False)
        pilot = None if starts_cloned(self) else RandomActions(run.sizes[1], run.rng("warm-up"))
        imitates = self.demonstrations.control != "constant_reward"
        if starts_cloned(self) and not run.folder.resumed:
            agent.bc_pretrain(demos, self.bc_pretrain_steps)

        def discriminate() -> None:
            enough = imitates and len(flights.buffer) >= size
            for _ in range(run.updates_due(self.replay.updates_per_step * self.reward.updates) if enough else 0):
                run.log(reward_net.learn(demos, flights.buffer, size // 2, agent.actor, self.reward))

        def update(improve: bool) -> dict[str, float]:
            if len(flights.buffer) < size:
                return {}
            batch = mixed(demos, flights.buffer, size, self.expert_share)
            batch = rewarded(batch, reward_net) if imitates else alive(batch)
            near = demos.sample(size // 2) if self.bc_weight and imitates else None
            metrics = agent.update(batch, demos=near, improve=improve)
            return {**metrics, "reward/mean": batch.rewards.mean().item()}

        parts = {"reward_net": reward_net, "expert_buffer": demos}
        learn_off_policy(run, self, agent, flights, update, pilot=pilot, parts=parts, prepare=discriminate)
        reward_net.save(run.folder.path)


def rewarded(batch: Batch, reward_net: RewardNet) -> Batch:
    """Return transitions with the newest reward."""
    return batch._replace(rewards=reward_net.reward(batch.obs, batch.actions))

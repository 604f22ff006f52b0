"""Generative adversarial imitation: a discriminator's output is the reward of proximal policy optimisation.

Each turn collects one rollout, lets a discriminator D learn to tell it from the demonstrations in ``reward.updates``
minibatches, half of either, by the loss

    ``-log D(s, a)`` of the demonstrator's ``- log(1 - D(s, a))`` of the agent's  ``+ lambda (|grad| - 1)^2``,

and moves the policy (:mod:`aerial_il.algorithms.ppo`) towards what the discriminator takes for demonstrated. The reward
is ``-log(1 - D)``, standardised by its running moments, and so are the discriminator's inputs. The value after a
terminal step is that of staying in the absorbing state for ever, whose reward is learned like any other.

``control`` runs the same without a demonstration, see :mod:`aerial_il.algorithms.dac`.

Metrics: those of ``ppo``; ``reward/loss``, ``reward/acc_expert``, ``reward/acc_agent`` (accuracies),
``reward/gradient_penalty``, ``reward/mean``. ``episode/return`` is the environment's own, which the agent never sees.

Source: J. Ho, S. Ermon, "Generative Adversarial Imitation Learning", 2016, with what A. Gleave et al., "imitation:
Clean Imitation Learning Implementations", 2022, found to matter.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.algorithms.adversarial.reward_net import (
    LearnedReward,
    RewardNet,
    starts_cloned,
)
from aerial_il.algorithms.on_policy.decisions import Decisions
from aerial_il.algorithms.on_policy.loop import learn_on_policy
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.on_policy.steps import StepPilot
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.problem import Given, Problem, check_steps, from_demonstrations, whole_turns
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, rows_of
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.ppo import ProximalActorCritic
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.core.checks import require_integer, require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.tensors import tensor
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class GAIL(Algorithm):
    """Generative adversarial imitation learning (Ho and Ermon 2016).

    Attributes:
        warmup: environment steps in which the clone acts as it is, and critic and discriminator alone learn.
        lr: learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
        reward: updates are the discriminator's steps for each rollout.
        reward_batch: transitions in its minibatch, half of them demonstrated.
        buffer_size: newest transitions of the agent that it is given.
    """

    name: ClassVar[str] = "gail"
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    bc_pretrain_steps: int = 0
    warmup: int = 0
    gamma: float = 0.99
    gae_lambda: float = 0.95
    lr: float = 3e-4
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=2048, epochs=10, batch_size=64)
    reward: LearnedReward = LearnedReward(
        form="gail",
        hidden=(64, 64),
        lr=1e-3,
        updates=12,
        gradient_penalty=1.0,
        spectral_norm=False,
        dropout=0.0,
        action_noise=False,
    )
    reward_batch: int = 1024
    buffer_size: int = 16_384
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "buffer_size")
        require_integer("reward_batch", self.reward_batch, 2)  # half of it is demonstrated
        if self.reward.updates != int(self.reward.updates):
            raise InvalidValueError(f"reward.updates is {self.reward.updates}; for each rollout it is a whole number.")

    def problem(self, given: Given) -> Problem:
        if not starts_cloned(self):
            rollout = whole_turns(
                self.rollout.steps, given.env.num_envs
            )  # for the last rollout no learning rate is left
            check_steps(self, "rollout.steps", rollout)
            check_steps(self, "warmup", (self.warmup // rollout + 1) * rollout)
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = ProximalActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes[0])
        reward_net, reward_norm = self.build_reward_net(run.sizes, agent.actor), RunningMoments(1)
        absorbing, imitates = self.demonstrations.absorbing, self.demonstrations.control != "constant_reward"
        expert_buffer = run.demos.buffer(run.interface, run.rng("expert"), absorbing=absorbing)
        buffer = ReplayBuffer(self.buffer_size, *run.sizes, run.rng("minibatches"))
        if starts_cloned(self) and not run.folder.resumed:
            agent.bc_pretrain(expert_buffer, self.bc_pretrain_steps)

        def rewarded(rollout: Decisions) -> tuple[np.ndarray, np.ndarray]:
            columns = (rollout.flat(name) for name in ("obs", "normalised", "rewards", "next_obs", "terminal"))
            buffer.add(rows_of(*columns, absorbing=absorbing))
            for _ in range(imitates * int(self.reward.updates)):
                run.log(reward_net.learn(expert_buffer, buffer, self.reward_batch // 2, agent.actor, self.reward))
            rewards, end_values = self._rewards(rollout, reward_net, reward_norm)
            run.log({"reward/mean": float(rewards.mean())})
            return rewards, end_values

        pilot = StepPilot(run, agent.actor, obs_norm=False)
        parts: dict[str, Any] = {"reward_net": reward_net, "reward_norm": reward_norm}
        parts |= {"expert_buffer": expert_buffer, "replay_buffer": buffer}
        warmup = self.warmup + 1 - whole_turns(self.rollout.steps, run.collector.n)  # the rollout that ends it teaches
        given = {"warmup": warmup, "rewarded": rewarded, "parts": parts}
        learn_on_policy(run, self, pilot, agent, agent.actor, **given)
        reward_net.save(run.folder.path)

    def build_reward_net(self, sizes: tuple[int, int], actor: SquashedGaussianNetwork) -> RewardNet:
        """Return a new discriminator for observations and actions of these ``sizes``."""
        return RewardNet(*sizes, self.reward.shape(running_norm=True), lr=self.reward.lr)

    def _rewards(
        self, rollout: Decisions, reward_net: RewardNet, reward_norm: RunningMoments
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return standardised rewards (T, n), and the value after each step (T, n) where it is terminal."""
        if self.demonstrations.control == "constant_reward":
            return np.ones_like(rollout.rewards), np.zeros_like(rollout.rewards)
        obs = tensor(np.pad(rollout.flat("obs"), ((0, 0), (0, 1))))
        rewards = reward_net.reward(obs, tensor(rollout.flat("normalised"))).numpy().astype(float)
        reward_norm.add(rewards[:, None])
        centre, deviation = reward_norm.mean[0], reward_norm.deviation[0]
        end_values = np.zeros_like(rewards)
        if self.demonstrations.absorbing and (ends := rollout.flat("terminal")).any():
            for_ever = reward_net.after(rollout.flat("next_obs")[ends])
            end_values[ends] = (for_ever - centre) / deviation / (1.0 - self.gamma)
        shape = rollout.rewards.shape
        return ((rewards - centre) / deviation).reshape(shape), end_values.reshape(shape)

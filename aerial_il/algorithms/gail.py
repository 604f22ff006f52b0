"""Generative adversarial imitation: a discriminator's output is the reward of proximal policy optimisation.

Each turn collects one rollout, lets a discriminator D learn to tell it from the demonstrations in ``reward_updates``
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

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.algorithms.adversarial.action_noise import sample_demos
from aerial_il.algorithms.adversarial.reward_net import RewardNet, discriminator_loss
from aerial_il.algorithms.adversarial.settings import Adversarial
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, rows_of
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.ppo import ProximalActorCritic
from aerial_il.algorithms.rl.on_policy import ProximalOnPolicy, Rollout, collect_rollout
from aerial_il.algorithms.run.checks import require_not_negative, require_positive
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class GAIL(Adversarial, ProximalOnPolicy):
    """Settings of a run, beside those of :class:`Adversarial` and :class:`ProximalOnPolicy`.

    Attributes:
        warmup: environment steps in which the clone acts as it is, and critic and discriminator alone learn.
        reward_updates: the discriminator's steps for each rollout. reward_batch: its minibatch.
        buffer_size: newest transitions of the agent that it is given.
    """

    name: ClassVar[str] = "gail"

    warmup: int = 0
    reward_updates: int = 12
    reward_batch: int = 1024
    buffer_size: int = 16_384

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "reward_batch", "buffer_size")
        require_not_negative(self, "warmup")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        if self.begins_cloned:
            return {}
        found = super().flown_before_learning(worlds)
        return {**found, "warmup": (self.warmup // found["rollout"] + 1) * found["rollout"]}

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = ProximalActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes[0])
        reward_net, reward_norm = self.build_reward_net(run.sizes, agent.actor), RunningMoments(1)
        expert_buffer = run.demos.buffer(run.interface, run.rng("expert"), absorbing=self.absorbing)
        buffer = ReplayBuffer(self.buffer_size, *run.sizes, run.rng("minibatches"))
        imitates = self.control != "constant_reward"
        if self.begins_cloned and not run.folder.resumed:
            agent.bc_pretrain(expert_buffer, self.bc_pretrain_steps)
        parts = {"agent": agent, "reward_net": reward_net, "reward_norm": reward_norm}
        run.begin(agent.actor, {**parts, "expert_buffer": expert_buffer, "replay_buffer": buffer})

        while run.goes_on():
            rollout = collect_rollout(run.collector, run.interface, agent, self.rollout)
            buffer.add(rows_of_rollout(rollout, absorbing=self.absorbing))
            for _ in range(imitates * self.reward_updates):
                half = self.reward_batch // 2
                demos = sample_demos(expert_buffer, half, agent.actor, action_noise=self.action_noise)
                loss, logged = discriminator_loss(reward_net, demos, buffer.sample(half), penalty=self.gradient_penalty)
                reward_net.descend(loss)
                run.log(logged)

            rewards, end_values = self._rewards(rollout, reward_net, reward_norm)
            run.log({"reward/mean": float(rewards.mean())})
            improve = run.collector.steps > self.warmup
            run.log(agent.update(rollout, rewards, left=run.left, end_values=end_values, improve=improve))
            run.end_turn()

        reward_net.save(run.folder.path)
        return run.finish()

    def _rewards(
        self, rollout: Rollout, reward_net: RewardNet, reward_norm: RunningMoments
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return standardised rewards (T, n), and the value after each step (T, n) where it is terminal."""
        if self.control == "constant_reward":
            return np.ones_like(rollout.rewards), np.zeros_like(rollout.rewards)
        obs = tensor(np.pad(rollout.flat("obs"), ((0, 0), (0, 1))))
        rewards = reward_net.reward(obs, tensor(rollout.flat("actions"))).numpy().astype(float)
        reward_norm.add(rewards[:, None])
        centre, deviation = reward_norm.mean[0], reward_norm.deviation[0]
        end_values = np.zeros_like(rewards)
        if self.absorbing and (ends := rollout.flat("terminal")).any():
            for_ever = reward_net.after(rollout.flat("next_obs")[ends])
            end_values[ends] = (for_ever - centre) / deviation / (1.0 - self.gamma)
        shape = rollout.rewards.shape
        return ((rewards - centre) / deviation).reshape(shape), end_values.reshape(shape)

    def build_reward_net(self, sizes: tuple[int, int], actor: SquashedGaussianNetwork) -> RewardNet:
        """Return a new discriminator for observations and actions of these ``sizes``."""
        return RewardNet(*sizes, self.reward_shape(running_norm=True), lr=self.reward_lr)


def rows_of_rollout(rollout: Rollout, *, absorbing: bool) -> np.ndarray:
    """Return a rollout as rows of a replay buffer."""
    names = ("obs", "actions", "rewards", "next_obs", "terminal")
    return rows_of(*(rollout.flat(name) for name in names), absorbing=absorbing)

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

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.algorithms.adversarial.action_noise import sample_demos
from aerial_il.algorithms.adversarial.discriminator import Reward
from aerial_il.algorithms.adversarial.reward_net import RewardNet, discriminator_loss
from aerial_il.algorithms.adversarial.settings import Adversarial
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, concatenated
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.off_policy import SoftOffPolicy, collect_step
from aerial_il.algorithms.run.checks import require_not_negative, require_share
from aerial_il.algorithms.sac import SoftActorCritic
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class DAC(Adversarial, SoftOffPolicy):
    """Settings of a run, beside those of :class:`Adversarial` and :class:`SoftOffPolicy`.

    Attributes:
        bc_pretrain_steps: minibatches of behavioural cloning before the first flight. Afterwards the clone acts in
            place of random actions, and until ``warmup`` critics and discriminator alone learn from it.
        bc_weight: weight of the actor's squared distance from demonstrated actions beside the critics' values.
        expert_share: share of demonstrated transitions in the agent's minibatches, rewarded like all others.
        reward_updates: the discriminator's steps for each of the agent's.
    """

    name: ClassVar[str] = "dac"

    lr_floor: float = 0.0
    bc_pretrain_steps: int = 5000
    bc_weight: float = 30.0
    expert_share: float = 0.0
    action_noise: bool = True
    reward: Reward = "airl"
    reward_hidden: tuple[int, ...] = (128, 128)
    reward_lr: float = 3e-4
    reward_updates: float = 0.5
    gradient_penalty: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "expert_share")
        require_not_negative(self, "bc_weight")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        return {} if self.begins_cloned else super().flown_before_learning(worlds)

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        blind = RandomActions(run.sizes[1], run.rng("warm-up"))
        agent = SoftActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        reward_net = self._build_reward_net(run.sizes)
        expert_buffer = run.demos.buffer(run.interface, run.rng("expert"), absorbing=self.absorbing)
        buffer = ReplayBuffer(self.buffer_size, *run.sizes, run.rng("minibatches"))
        imitates = self.control != "constant_reward"
        if self.begins_cloned and not run.folder.resumed:
            agent.bc_pretrain(expert_buffer, self.bc_pretrain_steps)
        parts = {"agent": agent, "reward_net": reward_net, "expert_buffer": expert_buffer}
        run.begin(agent.actor, {**parts, "replay_buffer": buffer, "random_actions": blind})

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            acts_blindly = warming_up and not self.begins_cloned
            step = collect_step(run.collector, run.interface, blind if acts_blindly else agent)
            buffer.add(step.rows(absorbing=self.absorbing))

            learns = not acts_blindly and len(buffer) >= self.batch_size
            for _ in range(learns * imitates * run.updates_due(self.utd_ratio * self.reward_updates)):
                half = self.batch_size // 2
                demos = sample_demos(expert_buffer, half, agent.actor, action_noise=self.action_noise)
                loss, logged = discriminator_loss(reward_net, demos, buffer.sample(half), penalty=self.gradient_penalty)
                reward_net.descend(loss)
                run.log(logged)

            agent.set_lr(self.lr_at(run.left))
            for _ in range(learns * run.updates_due(self.utd_ratio)):
                batch = self._minibatch(expert_buffer, buffer, reward_net)
                near = expert_buffer.sample(self.batch_size // 2) if self.bc_weight and imitates else None
                run.log(agent.update(batch, demos=near, bc_weight=self.bc_weight, improve=not warming_up))
                run.log({"reward/mean": batch.rewards.mean().item()})
            run.end_turn()

        reward_net.save(run.folder.path)
        return run.finish()

    def _minibatch(self, expert_buffer: ReplayBuffer, buffer: ReplayBuffer, reward_net: RewardNet) -> Batch:
        """Return what the agent learns from, with the newest reward, or a constant one for being alive."""
        shown = round(self.expert_share * self.batch_size)
        batch = buffer.sample(self.batch_size - shown)
        batch = concatenated(expert_buffer.sample(shown), batch) if shown else batch
        if self.control == "constant_reward":
            return batch._replace(rewards=1.0 - batch.obs[:, -1])
        return batch._replace(rewards=reward_net.reward(batch.obs, batch.actions))

    def _build_reward_net(self, sizes: tuple[int, int]) -> RewardNet:
        """Return a new discriminator; the interface has standardised its inputs by the demonstrations."""
        return RewardNet(*sizes, self.reward_shape(running_norm=False), lr=self.reward_lr)

"""Discriminator-actor-critic: adversarial imitation that learns from a memory of all that was flown.

A discriminator tells the demonstrator's transitions from the agent's, half of either in each minibatch, held back by a
gradient penalty, spectral normalisation or dropout. What it thinks is the reward of a soft actor-critic, recomputed for
each minibatch, so that old transitions are paid by the newest reward. Ends that matter lead to an absorbing state with
a reward of its own; see :mod:`aerial_il.algorithms.rl.replay_buffer`.

``control`` runs the same without a demonstration: ``random_actions`` puts flights of random actions in their place,
``constant_reward`` pays 1 for every step before an end and nothing is told apart. Whatever such a run reaches,
demonstrations did not cause.

Metrics: those of ``sac``; ``reward/loss``, ``reward/told_expert``, ``reward/told_agent`` (shares told rightly),
``reward/steep`` (gradient penalty), ``reward/mean``. ``episode/return`` is the environment's own, which the agent never
sees.

Source: I. Kostrikov et al., "Discriminator-Actor-Critic: Addressing Sample Inefficiency and Reward Bias in Adversarial
Imitation Learning", 2019; the discriminator's defaults after M. Orsini et al., "What Matters for Adversarial Imitation
Learning?", 2021. That it begins with a clone, stays near it and slows down to nothing is ours: ``docs/adversarial.md``
says what each is worth.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from aerial_il.algorithms.adversarial.action_noise import sample_shown
from aerial_il.algorithms.adversarial.discriminator import Reward
from aerial_il.algorithms.adversarial.reward_net import LearnedReward, Shape
from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import check_policy, read_lesson
from aerial_il.algorithms.rl.flown import fly_step
from aerial_il.algorithms.rl.replay_buffer import Batch, Replay, joined, rows_of
from aerial_il.algorithms.rl.session import Evaluate, open_session, origin_of
from aerial_il.algorithms.rl.settings import (
    Imitating,
    OffPolicy,
    require_choice,
    require_not_negative,
    require_positive,
    require_share,
    require_widths,
)
from aerial_il.algorithms.run.state import Generator
from aerial_il.algorithms.sac import agent_of
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class DiscriminatorActorCritic(Imitating, OffPolicy):
    """Settings of a run, beside those of :class:`Imitating` and :class:`OffPolicy`.

    Attributes:
        cloning: minibatches of behavioural cloning before the first flight; what it has learned then flies in place of
            random actions, and until ``warmup`` critics and discriminator alone learn from it.
        nearness: weight of the actor's squared distance from demonstrated actions beside what the critics think.
        expert_share: share of demonstrated transitions in the agent's minibatches, paid like all others.
        blur: show the discriminator demonstrated actions with the noise that the agent explores with; see ``gail``.
        reward: what the discriminator pays, ``gail``, ``airl`` or ``exit``.
        reward_hidden: its widths. reward_lr: its learning rate. reward_updates: its steps for each of the agent's.
        penalty: weight of the gradient penalty, 0 for none. spectral: normalise its matrices.
        dropout: of its inputs and hidden units.
    """

    lr_floor: float = 0.0
    cloning: int = 5000
    nearness: float = 30.0
    expert_share: float = 0.0
    blur: bool = True
    reward: Reward = "airl"
    reward_hidden: tuple[int, ...] = (128, 128)
    reward_lr: float = 3e-4
    reward_updates: float = 0.5
    penalty: float = 10.0
    spectral: bool = False
    dropout: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "reward_lr", "reward_updates")
        require_share(self, "expert_share")
        require_not_negative(self, "cloning", "nearness")
        require_share(self, "dropout", below_one=True)
        require_widths(self, "reward_hidden")
        require_choice(self, "reward", Reward)

    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicyConfig,
        *,
        env: Any,
        run: str | os.PathLike[str],
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Imitate the demonstrator by acting as it would, in ``env``, whose reward is not used.

        Args:
            dataset: episodes of that environment; failures among them are left out.
            policy: what to train, a ``squashed_gaussian``.
            env: a batch environment to fly in; it is reset.
            run: folder for configuration, metrics, checkpoints, the learned reward and the finished policy.
            seed: decides initial weights, exploration, minibatches and which episodes are flown.
            evaluate: ``(policy, step) -> named numbers`` to log every ``evaluate_every`` steps and at the end.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.

        Raises:
            InvalidValueError: nothing to learn from, another kind of policy or environment, or ``run`` holds another.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        policy = check_policy(policy)
        shown = read_lesson(dataset, policy, self, env, seed=seed)
        interface, sizes = shown.interface, shown.sizes
        origin = origin_of("dac", seed, env, shown.record)
        with open_session(
            self, run, origin, policy=policy, evaluate=evaluate, resume=resume, progress=progress
        ) as session:
            if session.folder.finished:
                return load_policy(run)
            flight = EndlessFlight(env, interface.layout, seed=seed)
            noise = Generator(named_rng(seed, "dac", "warm-up"))
            agent = agent_of(self, policy.build(*sizes), sizes)
            judge = self._judge(sizes)
            expert = shown.memory(named_rng(seed, "dac", "expert"), absorbing=self.absorbing)
            memory = Replay(self.memory, *sizes, named_rng(seed, "dac", "minibatches"))
            parts = {"agent": agent, "judge": judge, "expert": expert, "memory": memory, "noise": noise}
            nearness, cloning = (0.0, 0) if self.control == "constant_reward" else (self.nearness, self.cloning)
            if cloning and not session.folder.resumed:
                agent.clone(expert, cloning, self.batch_size)
            session.begin(flight, parts)

            def flying() -> ChunkPolicy:
                return session.pilot(policy, interface, agent.network)

            while session.goes_on(flying):
                warm = flight.steps < self.warmup
                blind = warm and not cloning
                flown = fly_step(flight, agent, interface, blind=noise if blind else None)
                memory.add(rows_of(*flown, absorbing=self.absorbing))

                learns = not blind and len(memory) >= self.batch_size
                judges = learns and self.control != "constant_reward"
                for _ in range(judges * session.owed(self.updates * self.reward_updates)):
                    half = self.batch_size // 2
                    demos = sample_shown(expert, half, agent.network, blur=self.blur)
                    session.note(judge.learn(demos, memory.sample(half), penalty=self.penalty))
                agent.learn_at(self.lr_at(session.left))
                for _ in range(learns * session.owed(self.updates)):
                    batch = self._minibatch(expert, memory, judge)
                    near = expert.sample(self.batch_size // 2) if nearness else None
                    found = agent.update(batch, shown=near, nearness=nearness, improve=not warm)
                    session.note({**found, "reward/mean": batch.rewards.mean().item()})
                session.turn(flying)

            judge.save(run)
            return session.finish(flying())

    def _judge(self, sizes: tuple[int, int]) -> LearnedReward:
        shape: Shape = {
            "hidden": self.reward_hidden,
            "spectral": self.spectral,
            "dropout": self.dropout,
            "running_norm": False,  # the interface has standardised by the demonstrations
            "actions": True,
            "form": self.reward,
        }
        return LearnedReward(*sizes, shape, lr=self.reward_lr)

    def _minibatch(self, expert: Replay, memory: Replay, judge: LearnedReward) -> Batch:
        """Return what the agent learns from, paid by the newest reward, or for being alive."""
        shown = round(self.expert_share * self.batch_size)
        batch = memory.sample(self.batch_size - shown)
        batch = joined(expert.sample(shown), batch) if shown else batch
        if self.control == "constant_reward":
            return batch._replace(rewards=1.0 - batch.obs[:, -1])
        return batch._replace(rewards=judge.pay(batch.obs, batch.actions))

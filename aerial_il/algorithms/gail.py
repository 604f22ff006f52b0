"""Generative adversarial imitation: a discriminator's opinion is the reward of proximal policy optimisation.

Each turn flies one rollout, lets the discriminator learn to tell it from the demonstrations in ``reward_updates``
minibatches, half of either, and moves the policy towards what the discriminator takes for demonstrated. The reward is
``-log(1 - D)``, standardised by its running moments, and so are the discriminator's inputs. An end that matters is
worth what staying in the absorbing state for ever would be paid, learned like any other reward.

``control`` runs the same without a demonstration, see :mod:`aerial_il.algorithms.dac`.

Metrics: those of ``ppo``; ``reward/loss``, ``reward/told_expert``, ``reward/told_agent`` (shares told rightly),
``reward/steep`` (gradient penalty), ``reward/mean``. ``episode/return`` is the environment's own, which the agent never
sees.

Source: J. Ho, S. Ermon, "Generative Adversarial Imitation Learning", 2016, with what A. Gleave et al., "imitation:
Clean Imitation Learning Implementations", 2022, found to matter.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.algorithms.adversarial.action_noise import sample_shown
from aerial_il.algorithms.adversarial.discriminator import Reward
from aerial_il.algorithms.adversarial.reward_net import LearnedReward
from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import check_policy, read_lesson
from aerial_il.algorithms.rl.replay_buffer import Replay, rows_of
from aerial_il.algorithms.rl.returns import RunningMoments
from aerial_il.algorithms.rl.rollout import Rollout, fly, learn, learner_of
from aerial_il.algorithms.rl.session import Evaluate, open_session, origin_of
from aerial_il.algorithms.rl.settings import (
    Imitating,
    OnPolicy,
    require_choice,
    require_not_negative,
    require_positive,
    require_share,
    require_widths,
)
from aerial_il.core.seeding import named_rng
from aerial_il.core.tensors import tensor
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class AdversarialImitation(Imitating, OnPolicy):
    """Settings of a run, beside those of :class:`Imitating` and :class:`OnPolicy`.

    Attributes:
        cloning: minibatches of behavioural cloning before the first flight. warmup: environment steps in which what it
            has learned flies as it is, and critic and discriminator alone learn.
        blur: show the discriminator demonstrated actions with the noise that the agent explores with. Else that noise
            is what it tells the agent by, long before it sees where the agent errs.
        reward: what the discriminator pays, ``gail``, ``airl`` or ``exit``.
        reward_hidden: its widths. reward_lr: its learning rate. reward_batch: its minibatch.
        reward_updates: its steps for each rollout. memory: newest flown transitions that it is shown.
        penalty: weight of the gradient penalty, 0 for none. spectral: normalise its matrices.
        dropout: of its inputs and hidden units.
    """

    name: ClassVar[str] = "gail"

    cloning: int = 0
    warmup: int = 0
    blur: bool = False
    reward: Reward = "gail"
    reward_hidden: tuple[int, ...] = (64, 64)
    reward_lr: float = 1e-3
    reward_batch: int = 1024
    reward_updates: int = 12
    memory: int = 16_384
    penalty: float = 1.0
    spectral: bool = False
    dropout: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "reward_lr", "reward_batch", "reward_updates", "memory")
        require_share(self, "dropout", below_one=True)
        require_widths(self, "reward_hidden")
        require_not_negative(self, "cloning", "warmup")
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
        """Imitate the demonstrator in ``env``, whose reward is not used; arguments and errors are those of ``dac``."""
        policy = check_policy(policy)
        shown = read_lesson(dataset, policy, self, env, seed=seed)
        interface, sizes = shown.interface, shown.sizes
        origin = origin_of(self.name, seed, env, shown.record)
        with open_session(
            self, run, origin, policy=policy, evaluate=evaluate, resume=resume, progress=progress
        ) as session:
            if session.folder.finished:
                return load_policy(run)
            flight = EndlessFlight(env, interface.layout, seed=seed)
            agent = learner_of(self, policy.build(*sizes), sizes[0])
            judge, paid = self.judge(sizes, agent.network), RunningMoments(1)
            expert = shown.memory(named_rng(seed, self.name, "expert"), absorbing=self.absorbing)
            memory = Replay(self.memory, *sizes, named_rng(seed, self.name, "minibatches"))
            if self.cloning and self.control != "constant_reward" and not session.folder.resumed:
                agent.clone(expert, self.cloning)
            session.begin(flight, {"agent": agent, "judge": judge, "paid": paid, "expert": expert, "memory": memory})

            def flying() -> ChunkPolicy:
                return session.pilot(policy, interface, agent.network)

            while session.goes_on(flying):
                rollout = fly(flight, agent, interface, self.rollout)
                memory.add(rows_of_rollout(rollout, absorbing=self.absorbing))
                for _ in range(0 if self.control == "constant_reward" else self.reward_updates):
                    half = self.reward_batch // 2
                    demos = sample_shown(expert, half, agent.network, blur=self.blur)
                    session.note(judge.learn(demos, memory.sample(half), penalty=self.penalty))
                rewards, end_values = self._pay(rollout, judge, paid)
                session.note({"reward/mean": float(rewards.mean())})
                improve, left = flight.steps > self.warmup, session.left
                session.note(learn(agent, rollout, rewards, self, left=left, end_values=end_values, improve=improve))
                session.turn(flying)

            judge.save(run)
            return session.finish(flying())

    def judge(self, sizes: tuple[int, int], actor: SquashedGaussian) -> LearnedReward:
        """Return a new discriminator for observations and actions of these ``sizes``."""
        return LearnedReward(
            *sizes,
            {
                "hidden": self.reward_hidden,
                "spectral": self.spectral,
                "dropout": self.dropout,
                "running_norm": True,
                "actions": True,
                "form": self.reward,
            },
            lr=self.reward_lr,
        )

    def _pay(self, rollout: Rollout, judge: LearnedReward, paid: RunningMoments) -> tuple[np.ndarray, ...]:
        """Return standardised rewards (T, n), and what all that follows each step would be worth if it were an end."""
        if self.control == "constant_reward":
            return np.ones_like(rollout.rewards), np.zeros_like(rollout.rewards)
        obs = tensor(np.pad(rollout.flat("obs"), ((0, 0), (0, 1))))
        rewards = judge.pay(obs, tensor(rollout.flat("actions"))).numpy().astype(float)
        paid.add(rewards[:, None])
        centre, deviation = paid.mean[0], paid.deviation[0]
        later = np.zeros_like(rewards)
        if self.absorbing and (ends := rollout.flat("terminal")).any():
            later[ends] = (judge.after(rollout.flat("next_obs")[ends]) - centre) / deviation / (1.0 - self.gamma)
        return tuple(values.reshape(rollout.rewards.shape) for values in ((rewards - centre) / deviation, later))


def rows_of_rollout(rollout: Rollout, *, absorbing: bool) -> np.ndarray:
    """Return a rollout as rows of a replay memory."""
    names = ("obs", "actions", "rewards", "next_obs", "terminal")
    return rows_of(*(rollout.flat(name) for name in names), absorbing=absorbing)

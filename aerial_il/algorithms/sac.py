"""Soft actor-critic: reinforcement learning from the environment's own reward, with a memory of all that was flown.

Each turn of the loop flies one step in every world, keeps it, and takes ``updates`` gradient steps for each environment
step on minibatches of the memory; the actor moves at every ``actor_every``-th of them, which saves a third of the time.
The mean action is what flies in the end.

Metrics: ``critic/loss``, ``critic/value``, ``actor/loss``, ``actor/entropy``, ``actor/alpha``; ``episode/return``,
``episode/length``, ``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: T. Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018; defaults are its table 1.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import check_policy, plain_interface
from aerial_il.algorithms.rl.flown import fly_step
from aerial_il.algorithms.rl.replay_buffer import Replay, rows_of
from aerial_il.algorithms.rl.session import Evaluate, open_session, origin_of
from aerial_il.algorithms.rl.settings import OffPolicy
from aerial_il.algorithms.rl.soft_actor_critic import SoftActorCritic
from aerial_il.algorithms.run.state import Generator
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class SoftActorCriticLearning(OffPolicy):
    """Settings of a run; see :class:`OffPolicy`."""

    rewarded: ClassVar[bool] = True

    def train(
        self,
        dataset: Iterable[Episode] | None,
        policy: PolicyConfig,
        *,
        env: Any,
        run: str | os.PathLike[str],
        seed: int = 0,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
    ) -> ChunkPolicy:
        """Learn to collect the environment's reward.

        Args:
            dataset: not looked at, there is a reward to learn from; taken so that every algorithm is called alike.
            policy: what to train, a ``squashed_gaussian``.
            env: a batch environment to fly in; it is reset.
            run: folder for configuration, metrics, checkpoints and the finished policy.
            seed: decides initial weights, exploration, minibatches and which episodes are flown.
            evaluate: ``(policy, step) -> named numbers`` to log every ``evaluate_every`` steps and at the end.
            resume: continue what ``run`` holds; a finished run returns its policy at once.
            progress: show a progress bar.

        Raises:
            InvalidValueError: another kind of policy, or ``run`` holds another run.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        policy = check_policy(policy)
        layout = Layout.of(env.spec, policy)
        interface = plain_interface(layout, policy)
        sizes = (layout.size, env.spec.action.size)
        origin = origin_of("sac", seed, env)
        with open_session(
            self, run, origin, policy=policy, evaluate=evaluate, resume=resume, progress=progress
        ) as session:
            if session.folder.finished:
                return load_policy(run)
            flight, noise = EndlessFlight(env, layout, seed=seed), Generator(named_rng(seed, "sac", "warm-up"))
            agent = agent_of(self, policy.build(*sizes), sizes)
            memory = Replay(self.memory, *sizes, named_rng(seed, "sac", "minibatches"))
            session.begin(flight, {"agent": agent, "memory": memory, "noise": noise})

            def flying() -> ChunkPolicy:
                return session.pilot(policy, interface, agent.network)

            while session.goes_on(flying):
                warm = flight.steps < self.warmup
                flown = fly_step(flight, agent, interface, blind=noise if warm else None)
                memory.add(rows_of(*flown, absorbing=False))
                agent.learn_at(self.lr_at(session.left))
                for _ in range(0 if warm else session.owed(self.updates)):
                    session.note(agent.update(memory.sample(self.batch_size)))
                session.turn(flying)

            return session.finish(flying())


def agent_of(settings: OffPolicy, actor: SquashedGaussian, sizes: tuple[int, int]) -> SoftActorCritic:
    """Return a new agent around ``actor`` for observations and actions of these ``sizes``."""
    return SoftActorCritic(
        actor,
        *sizes,
        hidden=settings.critic_hidden,
        lr=settings.lr,
        gamma=settings.gamma,
        tau=settings.tau,
        entropy=settings.entropy,
        alpha=settings.alpha,
        actor_every=settings.actor_every,
    )

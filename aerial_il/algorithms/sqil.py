"""Soft Q imitation learning: the demonstrator's transitions are worth 1, the agent's 0, and nothing else is learned.

A soft actor-critic on minibatches of which one half are demonstrations. To be paid, the agent must go where
demonstrations go and return there when it has strayed. Nothing adversarial, hence hard to break and quick; yet what it
is paid never changes, so an agent that imitates well is still paid 0, and long training can drift away again.

``control`` runs the same without a demonstration, see :mod:`aerial_il.algorithms.dac`; ``constant_reward`` pays 1 for
every step before an end.

Metrics: those of ``sac``; ``episode/return`` is the environment's own, which the agent never sees.

Source: S. Reddy, A. Dragan, S. Levine, "SQIL: Imitation Learning via Reinforcement Learning with Sparse Rewards", 2020.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import check_policy, read_lesson
from aerial_il.algorithms.rl.flown import fly_step
from aerial_il.algorithms.rl.replay_buffer import Batch, Replay, joined, rows_of
from aerial_il.algorithms.rl.session import Evaluate, open_session, origin_of
from aerial_il.algorithms.rl.settings import Imitating, OffPolicy
from aerial_il.algorithms.run.state import Generator
from aerial_il.algorithms.sac import agent_of
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class SoftQImitation(Imitating, OffPolicy):
    """Settings of a run; see :class:`Imitating` and :class:`OffPolicy`."""

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
        origin = origin_of("sqil", seed, env, shown.record)
        with open_session(
            self, run, origin, policy=policy, evaluate=evaluate, resume=resume, progress=progress
        ) as session:
            if session.folder.finished:
                return load_policy(run)
            flight = EndlessFlight(env, interface.layout, seed=seed)
            noise = Generator(named_rng(seed, "sqil", "warm-up"))
            agent = agent_of(self, policy.build(*sizes), sizes)
            expert = shown.memory(named_rng(seed, "sqil", "expert"), absorbing=self.absorbing, reward=1.0)
            memory = Replay(self.memory, *sizes, named_rng(seed, "sqil", "minibatches"))
            session.begin(flight, {"agent": agent, "expert": expert, "memory": memory, "noise": noise})

            def flying() -> ChunkPolicy:
                return session.pilot(policy, interface, agent.network)

            while session.goes_on(flying):
                warm = flight.steps < self.warmup
                flown = fly_step(flight, agent, interface, blind=noise if warm else None)
                unpaid = flown._replace(rewards=np.zeros(flight.n))
                memory.add(rows_of(*unpaid, absorbing=self.absorbing))
                agent.learn_at(self.lr_at(session.left))
                for _ in range(0 if warm else session.owed(self.updates)):
                    session.note(agent.update(self._minibatch(expert, memory)))
                session.turn(flying)

            return session.finish(flying())

    def _minibatch(self, expert: Replay, memory: Replay) -> Batch:
        """Return demonstrations and flown transitions, half of each; in the control run, flown ones paid for living."""
        if self.control == "constant_reward":
            batch = memory.sample(self.batch_size)
            return batch._replace(rewards=1.0 - batch.obs[:, -1])
        half = self.batch_size // 2
        return joined(expert.sample(half), memory.sample(self.batch_size - half))

"""Proximal policy optimisation: reinforcement learning from the environment's own reward, one rollout at a time.

Each turn flies ``rollout`` steps, estimates advantages, and moves actor and critic over them several times.
Observations are standardised by their running moments, rewards divided by the running deviation of returns; an episode
that was only cut by its time limit goes on in the critic's estimate.

Metrics: ``actor/loss``, ``actor/moved`` (Kullback-Leibler divergence), ``actor/clipped``, ``critic/loss``,
``critic/value``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring policy;
``evaluate/<name>``; ``elapsed_s``.

Source: J. Schulman et al., "Proximal Policy Optimization Algorithms", 2017; defaults are those of its table 3.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import check_policy, plain_interface
from aerial_il.algorithms.rl.returns import ReturnScale, RunningMoments
from aerial_il.algorithms.rl.rollout import fly, learn, learner_of
from aerial_il.algorithms.rl.session import Evaluate, open_session, origin_of
from aerial_il.algorithms.rl.settings import OnPolicy
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class ProximalPolicyOptimisation(OnPolicy):
    """Settings of a run; see :class:`OnPolicy`."""

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
        """Learn to collect the environment's reward; arguments and errors are those of ``sac``."""
        policy = check_policy(policy)
        layout = Layout.of(env.spec, policy)
        plain, sizes = plain_interface(layout, policy), (layout.size, env.spec.action.size)
        origin = origin_of("ppo", seed, env)
        with open_session(
            self, run, origin, policy=policy, evaluate=evaluate, resume=resume, progress=progress
        ) as session:
            if session.folder.finished:
                return load_policy(run)
            flight = EndlessFlight(env, layout, seed=seed)
            agent = learner_of(self, policy.build(*sizes), sizes[0])
            moments, paid = RunningMoments(sizes[0]), ReturnScale(flight.n, self.gamma)
            session.begin(flight, {"agent": agent, "moments": moments, "paid": paid})

            def interface() -> Interface:
                return replace(plain, obs=moments.normaliser()) if moments.count else plain

            def flying() -> ChunkPolicy:
                return session.pilot(policy, interface(), agent.network)

            while session.goes_on(flying):
                rollout = fly(flight, agent, interface(), self.rollout)
                rewards = paid.scale(rollout.rewards, rollout.ended)
                session.note(learn(agent, rollout, rewards, self, left=session.left))
                moments.add(layout.relate(rollout.flat("frames")))
                session.turn(flying)

            return session.finish(flying())

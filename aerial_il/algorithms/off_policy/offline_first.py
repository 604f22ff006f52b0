"""Offline first: an agent learns from a dataset, then flies and learns from the dataset and its flights alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.replay_buffer import Batch, mixed
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


def learn_offline_first(
    run: OnlineRun, settings: Algorithm, agent: Agent, learn: Callable[[Batch], Mapping[str, float]]
) -> ChunkPolicy:
    """Let ``agent`` learn, each time from a minibatch: ``offline_steps`` times from the dataset, then as it flies.

    It flies through the warm-up as it is; without ``offline_steps`` actions are random there. In each minibatch that
    follows, the share ``demos_share`` is of the dataset.
    """
    absorbing, size = settings.demonstrations.absorbing, settings.replay.batch_size
    demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=absorbing, reward=None)
    flights = ExperienceReplay(run, settings.replay.capacity, hindsight=settings.hindsight, absorbing=absorbing)
    pilot = agent if settings.offline_steps else RandomActions(run.sizes[1], run.rng("warm-up"))

    def update(improve: bool) -> Mapping[str, float]:
        del improve  # nothing is learned in the warm-up
        flown = len(flights.buffer) > 0
        return learn(mixed(demos, flights.buffer, size, settings.demos_share) if flown else demos.sample(size))

    parts = {"demonstrations": demos}
    learn_off_policy(run, settings, agent, flights, update, pilot=pilot, parts=parts, offline=settings.offline_steps)
    return run.finish()

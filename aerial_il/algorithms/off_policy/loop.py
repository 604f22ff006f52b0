"""The one off-policy loop: every algorithm calls it with its agent and with what one update is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import Explorer, RandomActions
from aerial_il.algorithms.off_policy.hindsight import Hindsight
from aerial_il.algorithms.off_policy.settings import Replay
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.policies.parts.chunk_policy import ChunkPolicy


class Settings(Protocol):
    """What the loop reads of an algorithm's settings."""

    @property
    def warmup(self) -> int: ...
    @property
    def lr(self) -> float: ...
    @property
    def lr_floor(self) -> float: ...
    @property
    def replay(self) -> Replay: ...
    @property
    def hindsight(self) -> Hindsight: ...


def learn_off_policy(
    run: OnlineRun,
    settings: Settings,
    agent: Agent,
    update: Callable[[ExperienceReplay, bool], Mapping[str, float]],
    *,
    pilot: Explorer | None = None,
    demos: ReplayBuffer | None = None,
    offline: int = 0,
    obs_norm: bool = False,
    absorbing: bool = False,
) -> ChunkPolicy:
    """Fly, store, learn, until no steps are left; return the trained policy.

    Args:
        agent: flies once the warm-up is over.
        update: one gradient step on the replay buffer, told whether the actor improves -> named numbers.
        pilot: who flies through the warm-up, while nothing is learned; ``agent`` flies but does not learn either; None
            for the agent, whose critics learn meanwhile.
        demos: demonstrations that are sampled from. offline: updates before the first flight.
        obs_norm, absorbing: see :class:`ExperienceReplay`.
    """
    hindsight = settings.hindsight
    replay = ExperienceReplay(
        run, settings.replay.capacity, hindsight=hindsight, obs_norm=obs_norm, absorbing=absorbing
    )
    random = pilot if isinstance(pilot, RandomActions) else RandomActions(run.sizes[1], run.rng("warm-up"))
    shown = {"demonstrations": demos} if demos is not None else {}
    run.begin(agent.actor, {"agent": agent, **shown, "random_actions": random, **replay.parts})

    for _ in run.offline(offline):
        run.log(update(replay, True))
    while run.goes_on():
        warming_up = run.collector.steps < settings.warmup
        waiting = warming_up and pilot is not None
        replay.step(pilot if waiting else agent)
        if not warming_up:
            replay.finish_warmup()
        agent.set_lr(settings.lr * (settings.lr_floor + (1.0 - settings.lr_floor) * run.left))
        for _ in range(0 if waiting else run.updates_due(settings.replay.updates_per_step)):
            run.log(update(replay, not warming_up))
        run.end_turn()
    return run.finish()

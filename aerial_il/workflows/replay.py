"""Fly recordings again from their recorded actions, and require every state to be the same, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from aerial_il.core.specs import EnvSpec
    from aerial_il.suite.batch import BatchEnvironment


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What is flown again.

    Attributes:
        path: dataset, or one file.
        starts: steps to resume from; those beyond an episode's end are left out.
        episodes: how many of them (null: all).
        progress: show a progress bar.
    """

    path: str
    starts: tuple[int, ...] = (0,)
    episodes: int | None = None
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, episodes=1)


class Replayed(NamedTuple):
    """How many episodes, and how many of their steps, were flown again and are equal."""

    episodes: int
    steps: int


def replay(settings: Replay) -> Replayed:
    """Replay, and return how much was compared.

    Raises:
        DemoError: a state differs, or the engine is another one.
    """
    from aerial_il.core.progress import Progress
    from aerial_il.data import replay as flights
    from aerial_il.data.dataset import open_dataset
    from aerial_il.suite.engine import ENGINE

    dataset = open_dataset(settings.path, failures=True)
    count = min(len(dataset), settings.episodes or len(dataset))
    env, spec, compared = None, None, 0
    shown = {"total": count, "desc": "replay", "unit": "ep", "disable": not settings.progress}
    try:
        for episode in Progress(islice(dataset, count), **shown):
            path = f"{settings.path}: {episode.uid}"
            flights.check_engine(ENGINE, episode, path)
            if env is None or episode.spec != spec:  # a dataset may hold several tiers, each in one piece
                if env is not None:
                    env.close()
                spec, env = episode.spec, _environment_of(episode.spec, num_envs=len(settings.starts))
            starts = [start for start in settings.starts if start < len(episode)]
            compared += flights.replay(env, episode, starts=starts, path=path)
    finally:
        if env is not None:
            env.close()
    return Replayed(count, compared)


def _environment_of(spec: EnvSpec, *, num_envs: int) -> BatchEnvironment:
    """Return a batch environment like the one that ``spec`` describes."""
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.suite.scenario import Scenario

    images = spec.observation.of_group("image")
    cameras = tuple(":".join(field.name.rsplit("_", 1)) for field in images)
    size = (images[0].shape[0], images[0].shape[1]) if images else (240, 320)
    scenario = Scenario(spec.robot, spec.task, spec.tier, spec.action.level, cameras, size, spec.controller)
    return BatchEnvironment(scenario, num_envs)

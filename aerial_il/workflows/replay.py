"""Fly recordings again from their recorded actions, and require every state to be the same, bit for bit."""

from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple, cast

from aerial_il.workflows.parts.names import at_least


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
    from aerial_il.workflows.parts.environments import reference_of

    dataset = open_dataset(settings.path, failures=True)
    count, worlds = min(len(dataset), settings.episodes or len(dataset)), len(settings.starts)
    spec, env, flown, compared = None, cast(Any, None), 0, 0
    shown = {"total": count, "desc": "replay", "unit": "ep", "disable": not settings.progress}
    with ExitStack() as stack:
        for episode in Progress(islice(dataset, count), **shown):
            path = f"{settings.path}: {episode.uid}"
            flights.check_engine(ENGINE, episode, path)
            if episode.spec != spec:  # a dataset may hold several tiers, each in one piece
                stack.close()
                spec, images = episode.spec, [field.name for field in episode.spec.observation.of_group("image")]
                env = stack.enter_context(closing(reference_of(spec, images=images).load(num_envs=worlds, threads=0)))
            starts = [start for start in settings.starts if start < len(episode)]
            compared += flights.replay(env, episode, starts=starts, path=path)
            flown += 1
    return Replayed(flown, compared)

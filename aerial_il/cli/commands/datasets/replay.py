"""Fly recordings again from their recorded actions and require every state to be the same, bit for bit.

Example: aerial-il replay datasets/pick
Example: aerial-il replay datasets/pick/demos/EPISODE.mcap starts=[0,100,200]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aerial_il.cli.configuration.keys import MISSING, at_least, key


@dataclass
class Config:
    path: str = key(MISSING, "dataset, or one file", position=0)
    starts: list[int] = key([0], "steps to resume from; those beyond an episode's end are left out")
    episodes: int | None = key(None, "how many of them (null: all)")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, episodes=1)


def run(config: Config) -> None:
    """Replay, and say how many steps were compared."""
    from itertools import islice

    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.replay import check_engine, replay
    from aerial_il.suite.engine import ENGINE

    dataset = open_dataset(config.path, failures=True)
    count = min(len(dataset), config.episodes or len(dataset))
    env, spec, compared = None, None, 0
    try:
        for episode in Progress(
            islice(dataset, count), total=count, desc="replay", unit="ep", disable=not config.progress
        ):
            path = f"{config.path}: {episode.uid}"
            check_engine(ENGINE, episode, path)
            if env is None or episode.spec != spec:  # a dataset may hold several tiers, each in one piece
                if env is not None:
                    env.close()
                spec, env = episode.spec, environment_of(episode.spec, num_envs=len(config.starts))
            starts = [start for start in config.starts if start < len(episode)]
            compared += replay(env, episode, starts=starts, path=path)
    finally:
        if env is not None:
            env.close()
    print(f"{config.path}: {count} episodes, {compared} steps flown again, every bit equal.")


def environment_of(spec: Any, *, num_envs: int) -> Any:
    """Return a batch environment like the one that ``spec`` describes."""
    import aerial_il

    images = spec.observation.of_group("image")
    return aerial_il.load_batch(
        spec.robot,
        spec.task,
        num_envs=num_envs,
        tier=spec.tier,
        action=spec.action.level,
        cameras=tuple(":".join(field.name.rsplit("_", 1)) for field in images),
        controller=spec.controller,
        image_size=(images[0].shape[0], images[0].shape[1]) if images else (240, 320),
    )

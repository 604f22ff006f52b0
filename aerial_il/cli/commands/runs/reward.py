"""Draw the reward that a run has learned along one recorded episode, and print its mean.

Runs of dac, gail and airl keep theirs. Beside it stands what the same flight would be paid with its actions shuffled.

Example: aerial-il reward runs/reach_dac dataset=datasets/reach episode=3
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import MISSING, MaybeLocated, at_least, key, path


@dataclass
class Config:
    run: str = key(MISSING, "folder of a finished run", position=0)
    dataset: MaybeLocated = path(MaybeLocated, "recordings to take the episode from")
    episode: int = key(0, "number of the episode, from 0")
    out: str | None = key(None, "the figure; reward.svg in the run's folder by default")

    def __post_init__(self) -> None:
        at_least(self, episode=0)


def run(config: Config) -> None:
    """Draw, and say where."""
    import aerial_il
    from aerial_il.core.errors import InvalidValueError
    from aerial_il.core.files import write_atomic
    from aerial_il.presentation.svg import reward_lines
    from aerial_il.workflows.parts.run_results import paid_along

    if config.dataset.path is None:
        raise InvalidValueError("The reward is drawn along a recorded episode: set dataset=PATH.")
    dataset = aerial_il.open_dataset(config.dataset.path)
    if config.episode >= len(dataset):
        raise InvalidValueError(f"episode={config.episode}; {config.dataset.path} has {len(dataset)}, counted from 0.")
    episode = dataset[config.episode]
    paid = paid_along(config.run, episode)
    figure = write_atomic(config.out or Path(config.run) / "reward.svg", reward_lines({episode.uid: paid}))
    means = ", ".join(f"{label} {values.mean():.3f}" for label, values in paid.items())
    print(f"Mean reward: {means}\nFigure: {figure}")

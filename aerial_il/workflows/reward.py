"""The reward that a run has learned, along one recorded episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True, kw_only=True)
class Reward:
    """Whose reward, along which episode.

    Attributes:
        run: folder of a finished run.
        dataset: recordings to take the episode from.
        episode: number of the episode, from 0.
        out: the figure; reward.svg in the run's folder by default.
    """

    run: str
    dataset: str | None = None
    episode: int = 0
    out: str | None = None

    def __post_init__(self) -> None:
        at_least(self, episode=0)


class Rewarded(NamedTuple):
    """What each step of an episode is paid, (T,), as flown and with its actions shuffled."""

    uid: str
    paid: dict[str, np.ndarray]


def reward(settings: Reward) -> Rewarded:
    """Return the learned reward along the episode."""
    from aerial_il.data.dataset import open_dataset
    from aerial_il.workflows.parts.run_results import paid_along

    if settings.dataset is None:
        raise InvalidValueError("The reward is drawn along a recorded episode: set dataset=PATH.")
    dataset = open_dataset(settings.dataset)
    if settings.episode >= len(dataset):
        raise InvalidValueError(f"episode={settings.episode}; {settings.dataset} has {len(dataset)}, counted from 0.")
    episode = dataset[settings.episode]
    return Rewarded(episode.uid, paid_along(settings.run, episode))

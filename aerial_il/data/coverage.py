"""What a dataset covers: where its numbers lie, where flights start, how time is spent; kept small."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from aerial_il.core.composition import dotted
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.quality.alone import AT_BOUND

MOST_ROWS = 40_000  # steps that are kept of all episodes together
MOST_VALUES = 12  # different values that are counted of an entry of the provenance
OF_ONE_FLIGHT = ("seed", "drawn")  # of the provenance
NO_PHASE = "none"
OTHERS = "others"  # values that are not counted apart


@dataclass(eq=False)
class Coverage:
    """What has been seen of the episodes that were added.

    Attributes:
        spec: of the environment of the first one; steps of another environment are not mixed with its own.
        rows_each: how many steps are kept of each, evenly spread.
        low, high: (Do + Da,) exact ends of all states and executed actions.
        at_bound: (Da,) steps in which an element of the action is at a bound.
        steps: of these episodes. others: episodes of another environment.
        phases: name -> steps. origin: dotted entry of the provenance -> its values and in how many episodes each is.
    """

    spec: EnvSpec
    rows_each: int
    low: np.ndarray
    high: np.ndarray
    at_bound: np.ndarray
    steps: int = 0
    others: int = 0
    phases: Counter[str] = field(default_factory=Counter)
    origin: dict[str, Counter[str]] = field(default_factory=dict)
    _rows: list[np.ndarray] = field(default_factory=list, repr=False)
    _starts: list[np.ndarray] = field(default_factory=list, repr=False)
    _solved: list[bool] = field(default_factory=list, repr=False)

    @staticmethod
    def of(first: Episode, episodes: int) -> Coverage:
        """Return the coverage of no episode yet, of which ``episodes`` are going to be like the first one."""
        observed = first.spec.observation
        size = observed.size(observed.state_names) + first.spec.action.size
        rows = max(1, MOST_ROWS // max(1, episodes))
        return Coverage(
            first.spec, rows, np.full(size, np.inf), np.full(size, -np.inf), np.zeros(first.spec.action.size)
        )

    def add(self, episode: Episode) -> bool:
        """Take an episode in; return whether it is of this environment."""
        self._count_origin(episode)
        if not self._is_alike(episode.spec):
            self.others += 1
            return False
        names = self.spec.observation.state_names
        states = episode.flat_obs(names) if names else np.zeros((len(episode) + 1, 0))
        rows = np.concatenate([states[:-1], episode.executed_actions], axis=1)
        self.low, self.high = np.minimum(self.low, rows.min(0)), np.maximum(self.high, rows.max(0))
        chosen = np.unique(np.linspace(0, len(rows) - 1, min(self.rows_each, len(rows))).round().astype(int))
        self._rows.append(rows[chosen].astype(np.float32))
        self._starts.append(states[0].astype(np.float32))
        self._solved.append(episode.success)
        self.at_bound += self._bounded(episode.executed_actions)
        self.steps += len(episode)
        self._count_phases(episode)
        return True

    @property
    def episodes(self) -> int:
        """How many were added, of other environments too."""
        return len(self._solved) + self.others

    @property
    def sees_images_alone(self) -> bool:
        """Whether there are no states."""
        return not self.spec.observation.state_names

    @property
    def solved(self) -> np.ndarray:
        """(E,) bool, which of the episodes succeeded."""
        return np.array(self._solved, bool)

    @property
    def states(self) -> np.ndarray:
        """(N, Do) states that were kept."""
        return np.concatenate(self._rows)[:, : -self.spec.action.size]

    @property
    def actions(self) -> np.ndarray:
        """(N, Da) executed actions that were kept."""
        return np.concatenate(self._rows)[:, -self.spec.action.size :]

    @property
    def starts(self) -> np.ndarray:
        """(E, Do) first state of each episode."""
        return np.stack(self._starts)

    def _is_alike(self, spec: EnvSpec) -> bool:
        """Whether states and actions have the same elements."""
        mine, other = self.spec, spec
        shapes = [[(n, s.observation[n].shape) for n in s.observation.state_names] for s in (mine, other)]
        return mine is other or (shapes[0] == shapes[1] and mine.action.labels == other.action.labels)

    def _bounded(self, actions: np.ndarray) -> np.ndarray:
        bounds = self.spec.action
        near = np.where(np.isfinite(bounds.reach), 2 * AT_BOUND * bounds.reach, 0.0)
        return ((actions < bounds.low + near) | (actions > bounds.high - near)).sum(0)

    def _count_phases(self, episode: Episode) -> None:
        names = list(episode.provenance.get("phases", ()))
        for number, count in zip(*np.unique(episode.phase, return_counts=True), strict=True):
            self.phases[str(names[number]) if 0 <= number < len(names) else NO_PHASE] += int(count)

    def _count_origin(self, episode: Episode) -> None:
        origin = {key: value for key, value in episode.provenance.items() if key not in OF_ONE_FLIGHT}
        for key, value in dotted(origin).items():
            counted = self.origin.setdefault(key, Counter())
            text = str(value)
            if value != {}:
                counted[text if text in counted or len(counted) < MOST_VALUES else OTHERS] += 1

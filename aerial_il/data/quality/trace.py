"""An episode as measures of quality see it: states and actions in units of how much they vary in the dataset."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.data.episode import Episode

RATE_HZ = 20.0  # at which steps are kept
POINTS = 24  # along an episode, from its first step to its last
TAILS, FARTHEST = (0.01, 0.99), 6.0  # quantiles within which it varies as usual; in its units, at most
LEAST_SPREAD = 1e-6  # of a number's largest magnitude, for it to vary


@dataclass(frozen=True, eq=False)
class Trace:
    """K steps of an episode, evenly spread over its T.

    Attributes:
        uid: its name. states: (K, Do) what was seen, images left out. actions: (K, Da) what was flown.
        interval_s: between them.
    """

    uid: str
    states: np.ndarray
    actions: np.ndarray
    interval_s: float

    def along(self) -> np.ndarray:
        """Return ``POINTS`` states and actions from the first to the last, (POINTS, Do + Da)."""
        rows = np.concatenate([self.states, self.actions], axis=1)
        return rows[np.linspace(0, len(rows) - 1, POINTS).round().astype(int)]


def trace_of(episode: Episode) -> Trace:
    """Return what is kept of an episode."""
    every = max(1, round(1.0 / (RATE_HZ * episode.spec.control_dt_s)))
    names = episode.spec.observation.state_names
    states = episode.flat_obs(names)[:-1:every].astype(np.float32)
    return Trace(
        episode.uid, states, episode.executed_actions[::every].astype(np.float32), every * episode.spec.control_dt_s
    )


def normalised(traces: Sequence[Trace]) -> list[Trace]:
    """Return the traces in units of the standard deviation over all; what never varies is left out."""
    states, actions = (_scale([getattr(t, name) for t in traces]) for name in ("states", "actions"))
    return [Trace(t.uid, states(t.states), actions(t.actions), t.interval_s) for t in traces]


def _scale(rows: Sequence[np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that scales rows (N, D)."""
    together = np.concatenate(rows)
    usual = np.clip(together, *np.quantile(together, TAILS, axis=0))
    mean, spread = usual.mean(axis=0), usual.std(axis=0)
    varies = spread > LEAST_SPREAD * np.abs(together).max(axis=0)
    return lambda values: np.clip((values[:, varies] - mean[varies]) / spread[varies], -FARTHEST, FARTHEST)

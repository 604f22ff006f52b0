"""What can be said of an episode alone: how long it stands still, how it jerks, how often it asks for the utmost."""

import numpy as np

from aerial_il.data.episode import Episode

STILL = 1e-3  # of an action's range, in a second: a command that changes less stands still
AT_BOUND = 1e-3  # of an action's range
TURN = "rot6d"  # in the labels of elements that jump where another turn serves as well


def idle(episode: Episode) -> float:
    """Share of the steps in which no command changes, but for the last half second, in which success is held."""
    held = round(0.5 / episode.spec.control_dt_s)
    actions = _scaled(episode)[: max(2, len(episode) - held)]
    change = np.abs(np.diff(actions, axis=0)).max(axis=1)
    return float(np.mean(change < STILL * episode.spec.control_dt_s)) if len(change) else 0.0


def jerk(episode: Episode) -> float:
    """Root mean square third difference of the actions, each as a share of its range; switches and turns left out."""
    actions = _moving(episode)
    return float(np.sqrt(np.mean(np.diff(actions, n=3, axis=0) ** 2))) if len(actions) > 3 and actions.size else 0.0


def saturation(episode: Episode) -> float:
    """Share of the steps in which an element of the action is at a bound; switches and turns left out."""
    actions = _moving(episode)
    at = (actions < AT_BOUND) | (actions > 1.0 - AT_BOUND)
    return float(at.any(axis=1).mean())


def _moving(episode: Episode) -> np.ndarray:
    """Return the elements of the actions that have more than two values, and are not of a rotation."""
    actions = _scaled(episode)
    switches = np.array([len(np.unique(column.round(3))) <= 2 for column in actions.T], bool)
    turns = np.array([TURN in label for label in episode.spec.action.labels])
    return actions[:, ~switches & ~turns]


def _scaled(episode: Episode) -> np.ndarray:
    bounds = episode.spec.action
    return (episode.executed_actions - bounds.low) / (bounds.high - bounds.low)

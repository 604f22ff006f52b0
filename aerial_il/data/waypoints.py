"""Relabelling of flights by hand: no-ops are left out, and an action becomes the pose that its flight reached later.

A scripted expert commands where it is going, a plain function of what is seen. A person nudges the commanded pose along
from where the tool is and waits between two nudges: nearly every step asks for next to no motion, wherever the tool is,
and a policy that clones it hangs in the air. What the person was after shows only later in the flight. So

1. steps in which the command stands still are left out, but for those around a move of the gripper, which takes its
   time, and those of the last moments, in which standing still is the task;
2. a gripper command on its way, as a key that is held makes it, becomes the one in which its move ends, or in which
   the controls were handed back: how far it has come shows nowhere that a policy may look;
3. the pose of an action becomes the pose that the tool reached ``lookahead_s`` of the remaining steps later, but never
   later than the beginning or the end of a move of the gripper, the end of what the person flew, or of the episode:
   what is passed by on the way to a grasp is no goal, the grasp is one;
4. steps that come so shortly before the controls were handed back that less than half of that way was flown are not
   learned from: where somebody let go is no goal either, and a policy that is led there stays there.

Only poses of the tool are relabelled (action level ``ee_pose``), and only as labels, ``Episode.expert_actions``:
observations and the actions that were executed stay as they were recorded.

Source: poses reached later as actions, C. Chi et al., "Universal Manipulation Interface", 2024; no-ops filtered, M. J.
Kim et al., "OpenVLA", 2024; moves of the gripper as keyframes, S. James and A. J. Davison, "Q-attention", 2022.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.provenance import flown_by_hand

LEVEL = "ee_pose"
LOOKAHEAD_S = 0.5  # for flights by hand
FlownBy = Literal["hand", "anyone"]
TURN = slice(3, 9)  # of an ``ee_pose`` action; before it the position, after it the gripper
STILL_M_S, STILL_ROT6D_S, STILL_GRIPPER_S = 0.01, 0.1, 0.05  # rates of a command that is taken to stand still
GRIP_MARGIN_S = 0.3  # before and after a move of the gripper
HOLD_S = 0.6  # at the end
ROUND = "round"  # in the settings of a flight of an algorithm that learns in rounds


@dataclass(frozen=True, kw_only=True)
class Waypoints:
    """How flights by hand are relabelled.

    Attributes:
        lookahead_s: how much later the pose is reached that becomes the action, s of steps that are not left out; 0
            leaves demonstrations as they were recorded.
        flown_by: whose flights are relabelled: those that a person flew ``hand``, as their provenance tells, or those
            of ``anyone``, for recordings from elsewhere that do not tell; never a learner's own, by whose side an
            expert was asked.
    """

    lookahead_s: float
    flown_by: FlownBy

    def __post_init__(self) -> None:
        if not 0 <= self.lookahead_s < np.inf:
            raise InvalidValueError(f"lookahead_s is {self.lookahead_s}; it must not be negative, e.g. 2.0.")
        if self.flown_by not in get_args(FlownBy):
            raise InvalidValueError(f"Unknown flown_by {self.flown_by!r}. Valid: {', '.join(get_args(FlownBy))}.")

    def apply(self, episode: Episode) -> Episode:
        """Return the episode relabelled, or itself where there is nothing to relabel.

        Raises:
            InvalidValueError: it has to be, but commands no pose of the tool.
        """
        if not self.lookahead_s or not (flown_by_hand(episode.provenance) or self._is_anyones(episode)):
            return episode
        if episode.spec.action.level != LEVEL:
            raise InvalidValueError(
                f"Episode {episode.uid}: its actions are {episode.spec.action.level}; only {LEVEL} can be relabelled "
                "by poses reached later. Learn from them as recorded: dataset.by_hand=false."
            )
        return relabelled(episode, round(self.lookahead_s / episode.spec.control_dt_s))

    def _is_anyones(self, episode: Episode) -> bool:
        """Whether anyone's flights are relabelled and this is one; not those of a learner, labelled by an expert."""
        return self.flown_by == "anyone" and ROUND not in (episode.provenance.get("settings") or {})


def relabelled(episode: Episode, lookahead: int) -> Episode:
    """Return ``episode`` without its no-ops, labelled by the poses reached ``lookahead`` of its steps later."""
    labels, flown, dt = np.array(episode.labels, float), episode.known, episode.spec.control_dt_s
    grips = (_change(labels)[:, TURN.stop :].max(1, initial=0.0) > STILL_GRIPPER_S * dt) & _goes_on(flown)
    gripping = _near(grips, round(GRIP_MARGIN_S / dt)) & flown
    left = np.flatnonzero(_moving(labels, dt) | gripping | ~flown | _held(episode))
    labels[:, TURN.stop :] = _decided(labels[:, TURN.stop :], grips, gripping)
    ahead = _reached(np.stack([gripping, flown], axis=1)[left], lookahead)
    reached = np.append(left, len(episode))[ahead]
    labels = labels[left]
    labels[:, :3] = episode.obs["ee_pos"][reached]
    labels[:, TURN] = episode.obs["ee_rot6d"][reached].reshape(-1, 6)
    labels[~_led_on(flown[left], ahead, lookahead)] = np.nan
    return replace(_only(episode, left), expert_actions=labels)


def _moving(labels: np.ndarray, dt: float) -> np.ndarray:
    """Return the steps (T,) whose commanded pose differs from the one before."""
    change = _change(labels)
    return (change[:, :3].max(1) > STILL_M_S * dt) | (change[:, TURN].max(1) > STILL_ROT6D_S * dt)


def _near(grips: np.ndarray, margin: int) -> np.ndarray:
    """Return the steps (T,) that are at most ``margin`` away from one of ``grips`` (T,)."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(grips, margin), 2 * margin + 1).max(1)


def _decided(commands: np.ndarray, grips: np.ndarray, gripping: np.ndarray) -> np.ndarray:
    """Return gripper commands (T, k) that are, from the first step of a move on, those in which it ends."""
    commands = commands.copy()
    for first, end in np.flatnonzero(np.diff(np.pad(gripping, 1).astype(int))).reshape(-1, 2):
        if not grips[first:end].any():  # near a move that somebody else broke off
            continue
        commands[first + int(np.argmax(grips[first:end])) : end] = commands[end - 1]
    return commands


def _goes_on(flown: np.ndarray) -> np.ndarray:
    """Return the steps (T,) that a person flew as the one before: another's command before it is no move of theirs."""
    return flown & np.concatenate([flown[:1], flown[:-1]])


def _change(labels: np.ndarray) -> np.ndarray:
    """Return by how much each step's command (T, Da) differs from the one before."""
    return np.abs(np.diff(labels, axis=0, prepend=labels[:1]))


def _held(episode: Episode) -> np.ndarray:
    """Return the last steps (T,) of an episode, in which standing still is the task."""
    return np.arange(len(episode)) >= len(episode) - round(HOLD_S / episode.spec.control_dt_s)


def _reached(stretches: np.ndarray, lookahead: int) -> np.ndarray:
    """Return for each step the one whose pose it is to lead to, T for the end, (T,).

    Args:
        stretches: (T, k), constant within a stretch that is not looked beyond.
    """
    steps = np.arange(len(stretches))
    ends = np.append(np.flatnonzero((np.diff(stretches, axis=0) != 0).any(1)) + 1, len(stretches))
    return np.minimum(steps + lookahead, ends[np.searchsorted(ends, steps, side="right")])


def _led_on(flown: np.ndarray, ahead: np.ndarray, lookahead: int) -> np.ndarray:
    """Return the steps (T,) that a person flew without those just before they handed back; all if no others are left.

    Args:
        flown: (T,) bool. ahead: (T,) where each step is led, T for the end. lookahead: steps.
    """
    given_back = ~np.append(flown, True)[ahead]
    led_on = flown & ~(given_back & (2 * (ahead - np.arange(len(flown))) < lookahead))
    return led_on if led_on.any() else flown


def _only(episode: Episode, steps: np.ndarray) -> Episode:
    """Return the episode with some of its steps (k,), and what it ended in."""
    seen, each = np.append(steps, len(episode)), {"actions", "executed_actions", "expert_actions", "is_intervention"}
    each |= {"phase", "rewards", "terminated", "truncated", "ctrl"}
    parts: dict[str, Any] = {name: getattr(episode, name)[steps] for name in each}
    parts |= {name: getattr(episode, name)[seen] for name in ("states", "sim_time")}
    return replace(episode, obs=_taken(episode.obs, seen), extras=_taken(episode.extras, steps), **parts)


def _taken(arrays: Mapping[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[rows] for name, values in arrays.items()}

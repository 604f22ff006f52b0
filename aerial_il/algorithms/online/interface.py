"""The way into and out of a network that acts step by step: observations standardised, actions in [-1, 1]."""

from dataclasses import replace
from typing import Literal, cast

import numpy as np

from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.layout import Interface, Layout, to_offsets
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.squashed_gaussian import SquashedGaussian

Bounds = Literal["environment", "demonstrations"]
MARGIN, NARROWEST = 1.1, 0.02  # of demonstrated ranges: a margin beyond them, and the least share of the environment's
NO_SCORES = (
    "The actions of {} are no scores of choices, each from 0 to 1: set policy.choices=bounds, or choose "
    "policy=squashed_gaussian and an algorithm that trains it."
)
IN_BOUNDS = "Set policy.anchor=null and policy.relative=false, or algorithm.demonstrations.bounds=demonstrations."
ANCHORED = "There are no demonstrations to take another range from: set policy.anchor=null and policy.relative=false."


def check_policy(policy: object, kinds: tuple[type[PolicySettings], ...] = (SquashedGaussian,)) -> PolicySettings:
    """Return ``policy`` if it is one of ``kinds``, and reinforcement learning can train it.

    Raises:
        InvalidValueError: it is another policy, sees images, or acts on more than one observation or step; where all
            kinds are taken, what is learned from decides.
    """
    if PolicySettings in kinds:
        return cast(PolicySettings, policy)
    if not isinstance(policy, PolicySettings) or not isinstance(policy, kinds):
        name = getattr(policy, "name", type(policy).__name__)
        choices = " or ".join(f"policy={kind.__module__.rpartition('.')[2]}" for kind in kinds)
        raise InvalidValueError(f"policy={name} is none that can explore here; choose {choices}.")
    if (policy.history, policy.chunk) != (1, 1):
        given = f"history={policy.history} and chunk={policy.chunk}"
        raise InvalidValueError(f"Reinforcement learning acts step by step: history and chunk must be 1, got {given}.")
    if policy.images:
        raise InvalidValueError(f"Reinforcement learning sees state fields; got images={list(policy.images)}.")
    return policy


def plain_interface(layout: Layout, policy: PolicySettings) -> Interface:
    """Return the interface without demonstrations: observations as they are, actions in the environment's bounds.

    Raises:
        InvalidValueError: actions are unbounded, no scores of discrete actions where these are wanted, or anchored:
            those have no bounds in the environment.
    """
    low, high = action_bounds(layout)
    if isinstance(policy, Categorical) and policy.choices == "one_hot" and ((low != 0) | (high != 1)).any():
        raise InvalidValueError(NO_SCORES.format(layout.spec.task))
    _refuse_anchor(layout, ANCHORED)
    obs = Normaliser.none(layout.size)
    return Interface(layout, obs, _between(low, high), policy.obs_clip, Switches.none(len(low)))


def standardised(interface: Interface, obs_norm: RunningMoments) -> Interface:
    """Return the interface with observations standardised by their moments so far."""
    return replace(interface, obs=obs_norm.normaliser()) if obs_norm.count else interface


def fit_interface(
    layout: Layout, frames: np.ndarray, actions: np.ndarray, *, policy: PolicySettings, bounds: Bounds
) -> Interface:
    """Return the interface fitted to demonstrations.

    Args:
        frames: (T, Do) in the world. actions: (T, Da) in the environment's units.
        bounds: what -1 and 1 stand for: the ``environment``'s bounds, or the range of the ``demonstrations`` with a
            tenth to spare, which keeps exploration near them.

    Raises:
        InvalidValueError: actions are unbounded, or anchored ones have no bounds in the environment.
    """
    obs, switches = Normaliser.fit(layout.relate(frames)), Switches.none(layout.spec.action.size)
    return Interface(layout, obs, _action(layout, frames, actions, bounds), policy.obs_clip, switches)


def encode(interface: Interface, frames: np.ndarray) -> np.ndarray:
    """Return the networks' input (N, Do) for frames (N, Do) in the world."""
    return interface.encode_obs(frames[:, None])[:, 0]


def decode(interface: Interface, actions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return actions (N, Da) in the environment's units for normalised ones, switches at one of their values."""
    decoded = interface.decode_actions(actions[:, None], frames[:, None])[:, 0]
    return interface.switches.snap(decoded).astype(np.float64)


def encode_actions(interface: Interface, actions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return normalised actions (N, Da), within [-1, 1], for those in the environment's units."""
    normalised = interface.encode_actions(actions[:, None].astype(np.float32), frames[:, None].astype(np.float32))
    return np.clip(normalised[:, 0], -1.0, 1.0)


def action_bounds(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Return the environment's lower and upper bounds of actions, (Da,) each.

    Raises:
        InvalidValueError: one of them is infinite.
    """
    low, high = np.asarray(layout.spec.action.low, float), np.asarray(layout.spec.action.high, float)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InvalidValueError("The environment's actions are not bounded; nothing can be explored between ±infinity.")
    return low, high


def _action(layout: Layout, frames: np.ndarray, actions: np.ndarray, bounds: Bounds) -> Normaliser:
    low, high = action_bounds(layout)
    if bounds == "environment":
        _refuse_anchor(layout, IN_BOUNDS)
        return _between(low, high)
    shown = to_offsets(layout, actions[:, None], frames[:, None])[:, 0]
    centre, half = 0.5 * (shown.min(0) + shown.max(0)), 0.5 * (shown.max(0) - shown.min(0))
    half = np.maximum(MARGIN * half, NARROWEST * 0.5 * (high - low))
    return _between(centre - half, centre + half)


def _between(low: np.ndarray, high: np.ndarray) -> Normaliser:
    return Normaliser((0.5 * (low + high)).astype(np.float32), (0.5 * (high - low)).astype(np.float32))


def _refuse_anchor(layout: Layout, hint: str) -> None:
    if layout.anchored or layout.relative:
        what = "the end effector" if layout.relative else layout.anchor
        raise InvalidValueError(f"Actions relative to {what} have no bounds in the environment. {hint}")

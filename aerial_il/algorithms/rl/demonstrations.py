"""Demonstrations as transitions, the way into a network fitted to them, and what takes their place in a control run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.replay_buffer import Replay, rows_of
from aerial_il.algorithms.rl.settings import Bounds, Imitating, Labels
from aerial_il.algorithms.supervised.training_set import read_demos
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import UNIMPORTANT
from aerial_il.policies.parts.layout import Interface, Layout, to_offsets
from aerial_il.policies.parts.normaliser import Normaliser
from aerial_il.policies.parts.switches import Switches
from aerial_il.policies.squashed_gaussian import SquashedGaussianConfig

MARGIN, NARROWEST = 1.1, 0.02  # of demonstrated ranges: room beyond them, and the least share of the environment's


class Transitions(NamedTuple):
    """T transitions in the environment's units.

    Attributes:
        frames, next_frames: (T, Do). actions: (T, Da) as executed. terminal: (T,) bool, see :class:`Steps`.
    """

    frames: np.ndarray
    actions: np.ndarray
    next_frames: np.ndarray
    terminal: np.ndarray


class Lesson(NamedTuple):
    """What an imitator is shown, ready for its networks.

    Attributes:
        interface: the way into and out of the networks. sizes: (Do, Da).
        transitions: what was demonstrated, or flown by chance in a control run.
        record: which demonstrations these are, for the run's record.
    """

    interface: Interface
    sizes: tuple[int, int]
    transitions: Transitions
    record: dict[str, Any]

    def memory(self, rng: np.random.Generator, *, absorbing: bool, reward: float = 0.0) -> Replay:
        """Return the transitions, each with ``reward``, as a memory to draw minibatches from."""
        rows = encode_transitions(self.interface, self.transitions, absorbing=absorbing, reward=reward)
        kept = Replay(len(rows), *self.sizes, rng)
        kept.add(rows)
        return kept


def read_lesson(
    dataset: Iterable[Episode], policy: SquashedGaussianConfig, settings: Imitating, env: Any, *, seed: int
) -> Lesson:
    """Read the demonstrations as ``settings`` ask; in the control run ``random_actions`` fly ``env`` in their place.

    Raises:
        InvalidValueError: there is nothing to learn from, or they come from another environment than ``env``.
    """
    layout, found, record = read_transitions(
        dataset,
        policy,
        trajectories=settings.trajectories,
        subsample=settings.subsample,
        labels=settings.labels,
        seed=seed,
    )
    check_same(layout.spec, env.spec)
    if settings.control == "random_actions":
        found = random_transitions(env, layout, len(found.frames), seed=seed)
    interface = fit_interface(layout, found, policy, settings.bounds)
    return Lesson(interface, (layout.size, layout.spec.action.size), found, record)


def check_policy(policy: object) -> SquashedGaussianConfig:
    """Return ``policy`` if reinforcement learning can train it.

    Raises:
        InvalidValueError: it is another policy, sees images, or acts on more than one observation or step.
    """
    if not isinstance(policy, SquashedGaussianConfig):
        name = getattr(policy, "name", type(policy).__name__)
        raise InvalidValueError(f"policy={name} has no density to explore with; choose policy=squashed_gaussian.")
    if (policy.history, policy.chunk) != (1, 1):
        found = f"history={policy.history} and chunk={policy.chunk}"
        raise InvalidValueError(f"Reinforcement learning acts step by step: history and chunk must be 1, got {found}.")
    if policy.images:
        raise InvalidValueError(f"Reinforcement learning sees state fields; got images={list(policy.images)}.")
    return policy


def read_transitions(
    dataset: Iterable[Episode],
    policy: SquashedGaussianConfig,
    *,
    trajectories: int | None,
    subsample: int,
    labels: Labels = "executed",
    seed: int,
) -> tuple[Layout, Transitions, dict[str, Any]]:
    """Return the layout, the transitions of the successful episodes, and which they are, for the run's record.

    Args:
        trajectories: how many episodes, the first ones; None for all.
        subsample: keep each so manieth transition, from a random one of the first on, and each end that matters.
        labels: which actions, ``executed`` or what the ``expert`` meant.
        seed: decides where the counting begins.

    Raises:
        InvalidValueError: see :func:`read_demos`; or there are fewer episodes than ``trajectories``.
    """
    layout, demos = read_demos(dataset, policy)
    if trajectories is not None and len(demos) < trajectories:
        raise InvalidValueError(f"trajectories is {trajectories}; the dataset has {len(demos)} successful ones.")
    demos = demos[:trajectories]
    rng = named_rng(seed, "subsample")
    parts = [_thin(_transitions_of(episode, layout, labels), subsample, rng) for episode in demos]
    found = Transitions(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    return layout, found, {"demonstrations": len(demos), "transitions": len(found.frames), "digest": digest_of(found)}


def check_same(shown: EnvSpec, flown: EnvSpec) -> None:
    """Refuse to learn in an environment that differs from the demonstrations' in more than its conditions.

    Raises:
        InvalidValueError: names each differing key.
    """
    if differing := shown.differences(flown, ignore=UNIMPORTANT):
        raise InvalidValueError(f"The demonstrations come from another environment: {'; '.join(differing)}.")


def random_transitions(env: Any, layout: Layout, count: int, *, seed: int) -> Transitions:
    """Fly ``count`` steps or a few more with actions drawn uniformly within their bounds: no demonstration at all."""
    flight, rng, low, high = EndlessFlight(env, layout, seed=seed), named_rng(seed, "control"), *_box(layout)
    steps = [flight.step(rng.uniform(low, high, (flight.n, len(low)))) for _ in range(-(-count // flight.n))]
    arrays = ([getattr(step, name) for step in steps] for name in Transitions._fields)
    return Transitions(*(np.concatenate(array) for array in arrays))


def fit_interface(layout: Layout, found: Transitions, policy: SquashedGaussianConfig, bounds: Bounds) -> Interface:
    """Return the way into and out of the networks: observations standardised, actions in [-1, 1].

    Args:
        bounds: what -1 and 1 stand for: the ``environment``'s bounds, or the range of the ``demonstrations`` with a
            tenth to spare, which keeps exploration near them.

    Raises:
        InvalidValueError: anchored actions have no bounds in the environment.
    """
    obs = Normaliser.fit(layout.relate(found.frames))
    return Interface(
        layout, obs, _action(layout, found, bounds), policy.obs_clip, Switches.none(layout.spec.action.size)
    )


def plain_interface(layout: Layout, policy: SquashedGaussianConfig) -> Interface:
    """Return the interface without demonstrations: observations as they are, actions in the environment's bounds."""
    low, high = _box(layout)
    _refuse_anchor(
        layout,
        "There are no demonstrations to take another range from: set policy.anchor=null and policy.relative=false.",
    )
    obs = Normaliser(np.zeros(layout.size, np.float32), np.ones(layout.size, np.float32))
    return Interface(layout, obs, _between(low, high), policy.obs_clip, Switches.none(len(low)))


def encode(interface: Interface, frames: np.ndarray) -> np.ndarray:
    """Return the networks' input (N, Do) for frames (N, Do) in the world."""
    return interface.encode_obs(frames[:, None])[:, 0]


def decode(interface: Interface, actions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return actions (N, Da) in the environment's units for normalised ones."""
    return interface.decode_actions(actions[:, None], frames[:, None])[:, 0].astype(np.float64)


def encode_actions(interface: Interface, actions: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Return normalised actions (N, Da), within [-1, 1], for those in the environment's units."""
    normalised = interface.encode_actions(actions[:, None].astype(np.float32), frames[:, None].astype(np.float32))
    return np.clip(normalised[:, 0], -1.0, 1.0)


def encode_transitions(interface: Interface, found: Transitions, *, absorbing: bool, reward: float = 0.0) -> np.ndarray:
    """Return transitions as rows of a replay memory, each with ``reward``."""
    return rows_of(
        encode(interface, found.frames),
        encode_actions(interface, found.actions, found.frames),
        np.full(len(found.frames), reward),
        encode(interface, found.next_frames),
        found.terminal,
        absorbing=absorbing,
    )


def digest_of(found: Transitions) -> str:
    """Return the SHA-256 of all that can be learned from."""
    seal = hashlib.sha256()
    for array in found:
        seal.update(np.ascontiguousarray(array).tobytes())
    return seal.hexdigest()


def _transitions_of(episode: Episode, layout: Layout, labels: Labels) -> Transitions:
    frames = layout.flatten(episode.obs)
    terminal = np.asarray(episode.terminated, bool).copy()
    terminal[-1] |= episode.success and not episode.truncated[-1]
    actions = episode.labels if labels == "expert" else episode.executed_actions
    return Transitions(frames[:-1], actions, frames[1:], terminal)


def _thin(found: Transitions, every: int, rng: np.random.Generator) -> Transitions:
    kept = (np.arange(len(found.frames)) % every == rng.integers(every)) | found.terminal
    return Transitions(*(array[kept] for array in found))


def _action(layout: Layout, found: Transitions, bounds: Bounds) -> Normaliser:
    low, high = _box(layout)
    if bounds == "environment":
        _refuse_anchor(layout, "Set policy.anchor=null and policy.relative=false, or algorithm.bounds=demonstrations.")
        return _between(low, high)
    shown = to_offsets(layout, found.actions[:, None], found.frames[:, None])[:, 0]
    centre, half = 0.5 * (shown.min(0) + shown.max(0)), 0.5 * (shown.max(0) - shown.min(0))
    half = np.maximum(MARGIN * half, NARROWEST * 0.5 * (high - low))
    return _between(centre - half, centre + half)


def _between(low: np.ndarray, high: np.ndarray) -> Normaliser:
    return Normaliser((0.5 * (low + high)).astype(np.float32), (0.5 * (high - low)).astype(np.float32))


def _box(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.asarray(layout.spec.action.low, float), np.asarray(layout.spec.action.high, float)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InvalidValueError("The environment's actions are not bounded; nothing can be explored between ±infinity.")
    return low, high


def _refuse_anchor(layout: Layout, hint: str) -> None:
    if layout.anchored or layout.relative:
        what = "the end effector" if layout.relative else layout.anchor
        raise InvalidValueError(f"Actions relative to {what} have no bounds in the environment. {hint}")

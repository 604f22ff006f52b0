"""Demonstrations as transitions, and the random flights that take their place in a control run."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from aerial_il.algorithms.online.collector import RECENT, Collector, RewardScheme, Transition
from aerial_il.algorithms.online.interface import Bounds, action_bounds
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.supervised.training_set import read_demos
from aerial_il.core.checks import require_choice, require_positive
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.flying import UNIMPORTANT
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import PolicySettings

Labels = Literal["executed", "expert"]
Control = Literal["none", "random_actions", "constant_reward"]
MEANT = (
    "labels=expert pairs what the demonstrator meant with the rewards of what was executed, so that critics would "
    "learn values of actions that nobody took: set algorithm.demonstrations.labels=executed."
)


@dataclass(frozen=True, kw_only=True)
class Demonstrations:
    """Which demonstrations are learned from, and how.

    Attributes:
        trajectories: how many, the first ones; null for all.
        subsample: keep one step in so many.
        bounds: what actions of ±1 stand for, the ``environment``'s bounds or the range of the ``demonstrations``.
        labels: what counts as the demonstrator's action where it was perturbed: what was ``executed``, or what the
            ``expert`` meant, which shows how to recover; only the former has a reward.
        absorbing: whether an end leads to an absorbing state: any in imitation; where the environment rewards, success
            alone, with its reward. Otherwise the value after it is zero.
        control: ``none``, or what stands in for demonstrations: ``random_actions``, or in imitation
            ``constant_reward``.
    """

    trajectories: int | None
    subsample: int
    bounds: Bounds
    labels: Labels
    absorbing: bool
    control: Control

    def __post_init__(self) -> None:
        require_positive(self, "subsample", *(["trajectories"] if self.trajectories is not None else []))
        require_choice(self, "bounds", Bounds)
        require_choice(self, "labels", Labels)
        require_choice(self, "control", Control)

    def check_in(self, algorithm: Any) -> None:
        """Raise :class:`InvalidValueError` where the algorithm learns from rewards that such demonstrations lack."""
        if algorithm.rewarded and self.control == "constant_reward":
            raise InvalidValueError(f"{algorithm.name} learns from a reward: control is none or random_actions.")
        if algorithm.rewarded and self.labels == "expert":
            raise InvalidValueError(MEANT)


def read_transitions(
    dataset: Iterable[Episode],
    policy: PolicySettings,
    *,
    trajectories: int | None,
    subsample: int,
    labels: Labels = "executed",
    rewarded: bool = False,
    failures: bool = False,
    smoothness: Smoothness | None = None,
    seed: int,
) -> tuple[Layout, Transition, dict[str, Any]]:
    """Return the layout, the transitions of the episodes, and which they are, for the run's record.

    Args:
        trajectories: how many episodes, the first ones; None for all.
        subsample: keep one transition in so many, counted from a random one of the first, and each terminal one.
        labels: which actions, ``executed`` or what the ``expert`` meant.
        rewarded: whether rewards are learned from, and so belong to the record.
        failures: whether failed episodes count too.
        smoothness: what rough actions cost; None for nothing.
        seed: decides where the counting starts.

    Raises:
        InvalidValueError: see :func:`read_demos`; or there are fewer episodes than ``trajectories``.
    """
    layout, demos = read_demos(dataset, policy, failures=failures)
    if trajectories is not None and len(demos) < trajectories:
        raise InvalidValueError(
            f"trajectories is {trajectories}; the dataset has {len(demos)}{'' if failures else ' successful'} ones."
        )
    demos = demos[:trajectories]
    rng = named_rng(seed, "subsample")
    rough = smoothness or NO_SMOOTHNESS
    parts = [_thin(_transitions_of(episode, layout, labels, rough), subsample, rng) for episode in demos]
    transitions = Transition(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    record = {"demonstrations": len(demos), "transitions": len(transitions.frames)}
    return layout, transitions, {**record, "digest": transitions.digest(rewarded=rewarded)}


def check_same(recorded: EnvSpec, spec: EnvSpec) -> None:
    """Refuse to learn in an environment that differs from the demonstrations' in more than its conditions.

    Raises:
        InvalidValueError: names each differing key.
    """
    if differing := recorded.differences(spec, ignore=UNIMPORTANT):
        raise InvalidValueError(f"The demonstrations come from another environment: {'; '.join(differing)}.")


def random_transitions(
    env: BatchEnv, layout: Layout, count: int, *, seed: int, scheme: RewardScheme | None = None
) -> Transition:
    """Collect ``count`` transitions or a few more with actions drawn uniformly within their bounds."""
    collector, rng = Collector(env, layout, seed=seed, scheme=scheme), named_rng(seed, "control")
    low, high = action_bounds(layout)
    steps = [collector.step(rng.uniform(low, high, (collector.n, len(low)))) for _ in range(-(-count // collector.n))]
    return Transition(*(np.concatenate(arrays) for arrays in zip(*steps, strict=True)))


def _transitions_of(episode: Episode, layout: Layout, labels: Labels, smoothness: Smoothness) -> Transition:
    frames = layout.flatten(episode.obs)
    terminal = np.asarray(episode.terminated, bool).copy()
    terminal[-1] |= episode.is_terminal
    actions = episode.labels if labels == "expert" else episode.executed_actions
    penalties, success = _penalties(episode, smoothness), terminal & bool(episode.success)
    rewards, truncated = episode.rewards - penalties, np.asarray(episode.truncated, bool)
    return Transition(frames[:-1], actions, rewards, frames[1:], terminal, truncated, success, penalties)


def _penalties(episode: Episode, smoothness: Smoothness) -> np.ndarray:
    """Return the penalties for the roughness of an episode's actions, (T,)."""
    steps = np.arange(len(episode))
    if not smoothness.penalises:
        return np.zeros(len(steps))
    when = np.maximum(steps[:, None] + 1 - RECENT + np.arange(RECENT), 0)
    return smoothness.penalties(episode.executed_actions[when], steps + 1, episode.spec.action)


def _thin(transitions: Transition, every: int, rng: np.random.Generator) -> Transition:
    kept = (np.arange(len(transitions.frames)) % every == rng.integers(every)) | transitions.terminal
    return Transition(*(array[kept] for array in transitions))

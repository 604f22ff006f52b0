"""A collector with auto-reset: each of its worlds takes the next seed when its episode is over.

An environment is what its seed and the actions since have made of it. A snapshot therefore holds these, and a
restored collector replays them: exact wherever equal seeds and actions give equal episodes, whether or not the
environment can save its state.
"""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.online.interface import encode, encode_actions
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, rows_of
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.run.state import Part, Snapshot
from aerial_il.core.contracts import BatchEnv
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError, SimulationDivergedError
from aerial_il.policies.parts.layout import Interface, Layout

FIRST_SEED = 1_000_000  # far from the seeds of demonstrations and evaluations, which count from 0 and from 10000


RECENT = 4  # actions that a jerk is computed from


@dataclass(frozen=True, kw_only=True)
class RewardScheme:
    """How a step is rewarded.

    Attributes:
        sparse: 1 for success in place of the environment's reward.
        smoothness: penalties for rough actions.
        patience: environment steps after which a run stops whose rewards carry no information; 0 for never.
        advice: what can be done about that, in a sentence.
    """

    sparse: bool = False
    smoothness: Smoothness = NO_SMOOTHNESS
    patience: int = 0
    advice: str = ""


class Transition(NamedTuple):
    """One step of n worlds, or n steps of demonstrations, in the environment's units.

    Attributes:
        frames: (n, Do) what was seen.
        actions: (n, Da) what was executed.
        rewards: (n,) of the step, penalties subtracted.
        next_frames: (n, Do) what was seen afterwards, before any reset.
        terminal: (n,) bool, the episode ended because of what happened: a crash, or success.
        truncated: (n,) bool, it was only cut: the world would have gone on.
        success: (n,) bool, the task is done.
        penalties: (n,) for rough actions.
    """

    frames: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_frames: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray
    success: np.ndarray
    penalties: np.ndarray

    def buffer(
        self, interface: Interface, rng: np.random.Generator, *, absorbing: bool, reward: float | None = 0.0
    ) -> ReplayBuffer:
        """Return the transitions, as :meth:`encoded` has them, as a buffer to draw minibatches from by ``rng``."""
        rows = self.encoded(interface, absorbing=absorbing, reward=reward)
        buffer = ReplayBuffer(len(rows), interface.layout.size, self.actions.shape[1], rng)
        buffer.add(rows)
        return buffer

    def encoded(self, interface: Interface, *, absorbing: bool, reward: float | None = 0.0) -> np.ndarray:
        """Return the transitions as rows of a replay buffer, each with ``reward``, or its own where that is None.

        In the latter case only success leads to an absorbing state: a crash's last reward is not repeated for ever.
        """
        return rows_of(
            encode(interface, self.frames),
            encode_actions(interface, self.actions, self.frames),
            self.rewards if reward is None else np.full(len(self.frames), reward),
            encode(interface, self.next_frames),
            self.terminal,
            absorbing=absorbing & self.success if reward is None else absorbing,
            penalties=self.penalties if reward is None else 0.0,
        )

    def digest(self, *, rewarded: bool) -> str:
        """Return the SHA-256 of all that is learned from: rewards too, where the algorithm is ``rewarded``."""
        seal, learned = hashlib.sha256(), (self.frames, self.actions, self.next_frames, self.terminal)
        for array in (*learned, self.rewards) if rewarded else learned:
            seal.update(np.ascontiguousarray(array).tobytes())
        return seal.hexdigest()


class Collector(Part):
    """n worlds of a batch environment, reset one by one as their episodes end.

    Args:
        env: a batch environment; it is reset.
        layout: how its observations become frames.
        seed: decides the seeds of its episodes.
        scheme: how their steps are rewarded; None for the environment's reward.

    Attributes:
        obs: what the worlds show now, ``name -> (n, ...)``. frames: (n, Do) the same, positions in the world.
        steps: environment steps of all worlds together.
        informed: whether two steps of the learner have had different rewards, or two of its episodes different
            returns: only then is there something to learn.
    """

    changing = ("_seeds", "_ages", "_returns", "frames", "_next", "steps", "_ended", "informed", "_first")

    def __init__(self, env: BatchEnv, layout: Layout, *, seed: int, scheme: RewardScheme | None = None) -> None:
        self.env, self.layout, self.n = env, layout, env.num_envs
        self.scheme, self.informed = scheme or RewardScheme(), False
        self._first: dict[str, float] = {}
        self._ends_at_success = env.ends_at_success
        self._seeds = FIRST_SEED * (1 + seed) + np.arange(self.n, dtype=np.int64)
        self._next = int(self._seeds[-1]) + 1
        self._ages, self._returns = np.zeros(self.n, np.int64), np.zeros(self.n)
        self._actions = np.zeros((self.n, 64, env.spec.action.size))
        self._ended: list[list[float]] = []
        self.steps = 0
        self.obs = env.reset(self._seeds)
        self.frames = layout.flatten(self.obs)

    def step(self, actions: np.ndarray, *, learner: np.ndarray | None = None) -> Transition:
        """Take one step with actions (n, Da) in the environment's units.

        Args:
            learner: (n,) bool, in which worlds the learner acts, whose rewards alone are information; None for all.

        Raises:
            SimulationDivergedError: an action or an observation is not finite; names seed and step.
        """
        self._check("action", np.asarray(np.isfinite(actions).all(axis=1)))
        actions = self.env.spec.action.clip(actions)
        self._record(actions)
        result = self.env.step(actions)
        try:
            after = self.layout.flatten(result.obs)
        except NonFiniteActionError as error:
            self._check(error.what, ~np.isin(np.arange(self.n), error.worlds))
            raise
        success = np.asarray(result.info.get("success", np.zeros(self.n)), bool)
        terminal = result.terminated | (success & self._ends_at_success)
        paid, penalties = success.astype(float) if self.scheme.sparse else result.reward, self._penalties()
        cut = result.truncated & ~terminal
        transition = Transition(self.frames, actions, paid - penalties, after, terminal, cut, success, penalties)
        self._returns += paid
        self.steps += self.n
        heard = np.ones(self.n, bool) if learner is None else learner
        self._listen("reward", paid[heard])
        self._listen("return", self._returns[(terminal | cut) & heard])
        self.obs = result.obs
        self.frames = self._auto_reset(after, terminal | result.truncated, success)
        return transition

    @contextmanager
    def lent(self) -> Iterator[BatchEnv]:
        """Lend the environment out: it may be reset and flown, and afterwards shows what it shows now."""
        state = self.snapshot()
        yield self.env
        self.restore(state)

    @property
    def first_reward(self) -> float:
        """The reward of the learner's first step; 0 if it has taken none."""
        return self._first.get("reward", 0.0)

    def episode_means(self) -> dict[str, float]:
        """Return mean return, length and success of the episodes that ended since the last report, and their number."""
        if not self._ended:
            return {}
        returns, length, success = np.mean(self._ended, axis=0)
        count, self._ended = len(self._ended), []
        return {
            "episode/return": returns,
            "episode/length": length,
            "episode/success": success,
            "episode/count": count,
        }

    def snapshot(self) -> Snapshot:
        arrays, values = super().snapshot()
        return Snapshot({**arrays, "flown": self._actions[:, : max(1, int(self._ages.max()))].copy()}, values)

    def restore(self, saved: Snapshot) -> None:
        """Replay the actions since the last resets.

        Raises:
            InvalidValueError: the environment now answers otherwise than it did.
        """
        super().restore(saved)
        self._actions = saved.arrays["flown"].copy()
        obs = self.env.reset(self._seeds)
        for age in range(int(self._ages.max(initial=0))):
            obs = self.env.step(self._actions[:, age], self._ages > age).obs
        self.obs, self.frames = obs, self.layout.flatten(obs)
        if not np.array_equal(self.frames, saved.arrays["frames"]):
            raise InvalidValueError(
                "The environment does not repeat itself: the same seeds and actions led elsewhere than before, so the "
                "run cannot go on exactly. Start it again with resume=false."
            )

    def _penalties(self) -> np.ndarray:
        """Return the penalty for the roughness of each world's last action, (n,)."""
        smoothness = self.scheme.smoothness
        if not smoothness.penalises:
            return np.zeros(self.n)
        when = np.maximum(self._ages[:, None] - RECENT + np.arange(RECENT), 0)
        recent = self._actions[np.arange(self.n)[:, None], when]
        return smoothness.penalties(recent, self._ages, self.env.spec.action)

    def _listen(self, what: str, values: np.ndarray) -> None:
        """Note whether any of ``values`` (k,) differs from the first one."""
        if not self.informed and len(values):
            self.informed = bool((values != self._first.setdefault(what, float(values[0]))).any())

    def _record(self, actions: np.ndarray) -> None:
        oldest = int(self._ages.max())
        if oldest >= self._actions.shape[1]:
            self._actions = np.concatenate([self._actions, np.zeros_like(self._actions)], axis=1)
        self._actions[np.arange(self.n), self._ages] = actions
        self._ages += 1

    def _auto_reset(self, after: np.ndarray, ended: np.ndarray, success: np.ndarray) -> np.ndarray:
        """Start the next episodes of the worlds in ``ended`` (n,); return what all worlds show."""
        if not ended.any():
            return after
        worlds = np.flatnonzero(ended)
        self._ended += [[float(self._returns[i]), float(self._ages[i]), float(success[i])] for i in worlds]
        self._seeds = self._seeds.copy()
        self._seeds[worlds] = self._next + np.arange(len(worlds))
        self._next += len(worlds)
        self._ages[worlds], self._returns[worlds] = 0, 0.0
        self.obs = self.env.reset(self._seeds, ended)
        return self.layout.flatten(self.obs)

    def _check(self, what: str, fine: np.ndarray) -> None:
        if not fine.all():
            world = int(np.argmin(fine))
            raise SimulationDivergedError(
                f"{what} became non-finite", seed=int(self._seeds[world]), step=int(self._ages[world])
            )

"""A scripted judge of segments: it prefers the one whose actions brought success nearer.

A sum of rewards would not tell good actions: late segments, near the goal, would win whatever is done in them. What
tells them is the advantage, what is to be expected after the segment less what was before it:

    score = d**L ((1 - f) V(s_end) + f G_end) - V(s_first),    G_t = d**(steps from t to success), 0 of a failure,

where L is the segment's length, V(s) the mean of G in states like s of the other flights that succeeded, fitted by
ridge regression on random Fourier features, and f the share of what followed (``followed``). So a segment that does as
successful flights do scores 0, a quicker one more, and one that waits, or undoes what was reached, less. Rewards are
not used.

It can be gamed. Success is all that it goes by: a flight that is wrongly called one shows what to do. V is a guess
where no success has been: a gripper that closed on nothing, seen without the object, may look like a grasp. What is
rough or dangerous on the way costs nothing, unless it takes time. And a share f of what a later part of the same flight
did well or badly is credited to the segment; with f = 1 flights are compared rather than segments.

Source: W. B. Knox et al., "Models of Human Preference for Learning Reward Functions", 2022, section 3: people judge
segments by regret; A. Rahimi and B. Recht, "Random Features for Large-Scale Kernel Machines", 2007, algorithm 1.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aerial_il.core.checks import require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.data.preferences.pairs import Pair, Preference, Preferred, Segment, flip

BY_HAND = "Judge by hand: aerial-il prefer by=hand."
FOLDS = 5  # a flight's own outcome must not tell its values
FEATURES, WIDTH, RIDGE = 384, 1.5, 1e-3  # of the kernel, as for consistency of demonstrations
EVERY = 4  # steps, of which one is fitted
FARTHEST = 4.0  # standard deviations of a state that are told apart


@dataclass(frozen=True, kw_only=True)
class ScriptedJudge:
    """A judge of segments by success and the time to it.

    Attributes:
        horizon_s: after how long success counts 1/e of success at once.
        followed: share of what came after the segment, in place of what was to be expected then.
        margin: difference of two scores below which the segments are equal.
        flipped: share of the answers, drawn at random, that are turned round, as a careless person would.
        seed: of that.
    """

    horizon_s: float
    followed: float
    margin: float
    flipped: float
    seed: int

    def __post_init__(self) -> None:
        require_positive(self, "horizon_s")
        require_share(self, "followed", "flipped")
        require_not_negative(self, "margin", "seed")

    def judge(self, episodes: Iterable[Episode], pairs: Sequence[Pair]) -> Iterator[Preference]:
        """Yield a preference for each of the pairs, in their order.

        Args:
            episodes: all flights of the dataset, of one environment. pairs: of segments of theirs.

        Raises:
            InvalidValueError: fewer than two flights succeed, or they show no state.
        """
        values = _Values(list(episodes), self.horizon_s, self.followed)
        for left, right in pairs:
            better = values.score(left) - values.score(right)
            preferred: Preferred = "equal" if abs(better) <= self.margin else "left" if better > 0.0 else "right"
            mistaken = named_rng(self.seed, "flipped", str((left, right))).random() < self.flipped
            yield Preference(left, right, flip(preferred) if mistaken else preferred, "script")


class _Values:
    """What came after each step of some flights, and what was to be expected.

    Args:
        episodes: the flights. horizon_s: of the discount. followed: as of the judge.
    """

    def __init__(self, episodes: Sequence[Episode], horizon_s: float, followed: float) -> None:
        won = np.array([episode.success for episode in episodes])
        if won.sum() < 2:
            raise InvalidValueError(
                f"The script judges by success, and {won.sum()} of {len(won)} flights succeed: it takes 2. {BY_HAND}"
            )
        self._followed, self._decay = followed, np.exp(-episodes[0].spec.control_dt_s / horizon_s)
        self._outcomes = {e.uid: e.success * self._decay ** np.arange(len(e), -1.0, -1.0) for e in episodes}
        expected = _fitted([_states(e) for e in episodes], list(self._outcomes.values()), won)
        self._expected = {e.uid: each for e, each in zip(episodes, expected, strict=True)}
        for uid, outcomes in self._outcomes.items():
            self._expected[uid][-1] = outcomes[-1]  # nothing follows

    def score(self, segment: Segment) -> float:
        """Return the advantage of a segment."""
        outcomes, expected = self._outcomes[segment.uid], self._expected[segment.uid]
        end = segment.first + segment.length
        after = (1.0 - self._followed) * expected[end] + self._followed * outcomes[end]
        return float(self._decay**segment.length * after - expected[segment.first])


def _states(episode: Episode) -> np.ndarray:
    if not (names := episode.spec.observation.state_names):
        raise InvalidValueError(f"Episode {episode.uid} shows no state field, by which the script judges. {BY_HAND}")
    return episode.flat_obs(names)


def _fitted(states: Sequence[np.ndarray], outcomes: Sequence[np.ndarray], won: np.ndarray) -> list[np.ndarray]:
    """Return the values (T + 1,) of each flight's states (T + 1, D), fitted to the successes of other folds.

    Args:
        states, outcomes: of each flight. won: (E,) bool, whether it succeeded.
    """
    seen = np.concatenate([each[::EVERY] for each in states])
    mean, spread = seen.mean(axis=0), seen.std(axis=0)
    varies = spread > 1e-6 * np.abs(seen).max(axis=0)
    rng = named_rng(0, "values of states")
    weights = rng.normal(0.0, 1.0 / (WIDTH * np.sqrt(max(1, varies.sum()))), (int(varies.sum()), FEATURES))
    phases = rng.uniform(0.0, 2.0 * np.pi, FEATURES)

    def features(shown: np.ndarray) -> np.ndarray:
        scaled = np.clip((shown[:, varies] - mean[varies]) / spread[varies], -FARTHEST, FARTHEST)
        return np.concatenate([np.cos(scaled @ weights + phases), scaled, np.ones((len(scaled), 1))], axis=1)

    fold = np.empty(len(states), int)
    for group in (np.flatnonzero(won), np.flatnonzero(~won)):
        fold[group] = rng.permutation(len(group)) % FOLDS
    rows = {i: (features(states[i][::EVERY]), outcomes[i][::EVERY]) for i in np.flatnonzero(won)}
    fitted = [_solved([row for i, row in rows.items() if fold[i] != own]) for own in range(FOLDS)]
    return [np.clip(features(s) @ fitted[k], 0.0, 1.0) for s, k in zip(states, fold, strict=True)]


def _solved(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the weights (F,) of ridge regression on each flight's features (N, F) and outcomes (N,), all alike."""
    gram = np.sum([f.T @ f / len(f) for f, _ in rows], axis=0)
    moment = np.sum([f.T @ g / len(g) for f, g in rows], axis=0)
    return np.linalg.solve(gram + RIDGE * len(rows) * np.eye(len(moment)), moment)

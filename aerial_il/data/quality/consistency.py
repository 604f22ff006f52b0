"""Whether an episode acts as others do where they see the same: what they would do is learned, and compared.

The episodes are dealt into folds. How actions depend on states is fitted on all folds but one, by ridge regression on
random Fourier features, whose kernel is Gaussian, and the episodes of that one are held against it. The fifth that was
missed by most is then left out, and all is done once more.

Source: A. Rahimi and B. Recht, "Random Features for Large-Scale Kernel Machines", 2007, algorithm 1.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from aerial_il.core.seeding import named_rng
from aerial_il.data.quality.trace import Trace

FOLDS = 4
FEATURES = 768
TRUSTED = 0.8  # share of the episodes that are learned from in the end, those that are like others at first
WIDTH = 1.5  # of the kernel, in standard deviations of a state times the root of their number
RIDGE = 1e-3  # of the number of rows
LONGEST_LAG, BETTER = 10, 0.95  # rows; of the difference without a shift
BLOCK = 20_000  # rows at once

Features = Callable[[np.ndarray], np.ndarray]


class Consistency(NamedTuple):
    """How an episode acts, held against what others do where they see the same.

    Attributes:
        missed: root mean square difference, over that of the median episode. lag_s: by how much its actions come after
            those that they are most like; 0 where no shift makes them much more alike.
    """

    missed: float
    lag_s: float


def consistency(traces: Sequence[Trace]) -> dict[str, Consistency]:
    """Return the name of each episode -> how it acts.

    Args:
        traces: normalised, at least two.
    """
    rng = named_rng(0, "consistency")
    size = traces[0].states.shape[1]
    weights = rng.normal(0.0, 1.0 / (WIDTH * np.sqrt(size)), (size, FEATURES))
    phases = rng.uniform(0.0, 2.0 * np.pi, FEATURES)

    def features(states: np.ndarray) -> np.ndarray:
        waves = np.cos(states @ weights + phases)
        return np.concatenate([waves, states, np.ones((len(states), 1))], axis=1)

    fold = rng.permutation(len(traces)) % min(FOLDS, len(traces))
    first = _expected(traces, fold, np.ones(len(traces), bool), features)
    apart = np.array([_apart(trace.actions, each, 0) for trace, each in zip(traces, first, strict=True)])
    found = _expected(traces, fold, apart <= np.quantile(apart, TRUSTED), features)
    missed = [_apart(trace.actions, each, 0) for trace, each in zip(traces, found, strict=True)]
    usual = float(np.median(missed)) or 1.0
    return {
        trace.uid: Consistency(off / usual, _lag(trace.actions, each) * trace.interval_s)
        for trace, each, off in zip(traces, found, missed, strict=True)
    }


def _expected(traces: Sequence[Trace], fold: np.ndarray, trusted: np.ndarray, features: Features) -> list[np.ndarray]:
    """Return what those episodes that are ``trusted`` (E,), of other folds than its own, say of each one's actions."""
    folds = range(fold.max() + 1)
    chosen = [[traces[i] for i in np.flatnonzero((fold == k) & trusted)] for k in folds]
    sums = [_sums(each, features) if each else None for each in chosen]  # of a small fold none may be trusted
    fitted = []
    for k in folds:
        others = [each for j, each in enumerate(sums) if j != k and each is not None]
        gram, moment = np.sum([each[0] for each in others], axis=0), np.sum([each[1] for each in others], axis=0)
        rows = sum(each[2] for each in others)
        fitted.append(np.linalg.solve(gram + RIDGE * rows * np.eye(len(gram)), moment))
    return [features(trace.states) @ fitted[k] for trace, k in zip(traces, fold, strict=True)]


def _lag(actions: np.ndarray, expected: np.ndarray) -> int:
    """Return by how many rows actions (K, Da) come after what is expected.

    That they come before it says nothing: what is expected follows from the present state, a plan looks ahead.
    """
    apart = {shift: _apart(actions, expected, shift) for shift in range(min(LONGEST_LAG, len(actions) // 4) + 1)}
    best = min(apart, key=lambda shift: apart[shift])
    return best if apart[best] < BETTER * apart[0] else 0


def _apart(actions: np.ndarray, expected: np.ndarray, shift: int) -> float:
    """Return the root mean square difference of actions from what is expected ``shift`` rows before."""
    return float(np.sqrt(np.mean((actions[shift:] - expected[: len(expected) - shift]) ** 2)))


def _sums(traces: Sequence[Trace], features: Features) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the Gram matrix of some episodes' features, their product with the actions, and the number of rows."""
    gram, moment, rows = 0.0, 0.0, 0
    states, actions = np.concatenate([t.states for t in traces]), np.concatenate([t.actions for t in traces])
    for start in range(0, len(states), BLOCK):
        block, wanted = features(states[start : start + BLOCK]), actions[start : start + BLOCK]
        gram, moment, rows = gram + block.T @ block, moment + block.T @ wanted, rows + len(block)
    return np.asarray(gram), np.asarray(moment), rows

"""How much an episode's states tell of its actions: demonstrations that are clear and varied at once have much.

The mutual information of states and actions is estimated from distances to nearest neighbours, and each step's share of
it is averaged over its episode. States and actions are compressed to their principal components first, where the source
trains autoencoders.

Source: J. Hejna et al., "Robot Data Curation with Mutual Information Estimators" (DemInf), 2025, section 4; A. Kraskov
et al., "Estimating Mutual Information", 2004, equation 8.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import digamma

from aerial_il.core.seeding import named_rng
from aerial_il.data.quality.trace import Trace

STATE_SIZE, ACTION_SIZE = 12, 6  # principal components
NEIGHBOURS = (5, 6, 7)
AT_ONCE, PASSES = 1024, 2  # steps that are neighbours of each other; how often all are dealt into such sets


def information(traces: Sequence[Trace]) -> dict[str, float]:
    """Return the name of each episode -> mean share of its steps in the mutual information, nats.

    Args:
        traces: normalised.
    """
    states = _compressed(np.concatenate([trace.states for trace in traces]), STATE_SIZE)
    actions = _compressed(np.concatenate([trace.actions for trace in traces]), ACTION_SIZE)
    rng, total = named_rng(0, "information"), np.zeros(len(states))
    for _ in range(PASSES):
        order = rng.permutation(len(states))
        for chosen in np.array_split(order, max(1, round(len(order) / AT_ONCE))):
            total[chosen] += _shares(states[chosen], actions[chosen])
    ends = np.cumsum([len(trace.states) for trace in traces])
    parts = np.split(total / PASSES, ends[:-1])
    return {trace.uid: float(part.mean()) for trace, part in zip(traces, parts, strict=True)}


def _shares(states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Return each step's share (N,) by Kraskov's estimator, for the mean of several numbers of neighbours."""
    count = len(states)
    if count <= max(NEIGHBOURS):
        return np.zeros(count)
    apart = np.stack([_distances(states), _distances(actions)])
    nearest = np.sort(apart.max(axis=0), axis=1)
    share = np.zeros(count)
    for k in NEIGHBOURS:
        near = np.maximum(np.sum(apart < nearest[:, k : k + 1], axis=2), 1)  # itself among them, also of equal rows
        share += digamma(k) + digamma(count) - digamma(near[0]) - digamma(near[1])
    return share / len(NEIGHBOURS)


def _distances(rows: np.ndarray) -> np.ndarray:
    """Return the largest difference of two rows in any element, for all pairs of rows (N, D): (N, N)."""
    found = np.zeros((len(rows), len(rows)), np.float32)
    rows = rows.astype(np.float32)
    for k in range(rows.shape[1]):
        np.maximum(found, np.abs(rows[:, k, None] - rows[:, k]), out=found)
    return found


def _compressed(rows: np.ndarray, size: int) -> np.ndarray:
    """Return the principal components of rows (N, D), each scaled to unit variance, at most ``size`` of them."""
    centred = rows - rows.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov(centred, rowvar=False).reshape(rows.shape[1], -1))
    kept = [i for i in np.argsort(values)[::-1][:size] if values[i] > 1e-9 * values[-1]]
    return centred @ vectors[:, kept] / np.sqrt(values[kept])

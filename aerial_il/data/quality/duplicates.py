"""Episodes that are the same as another one."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from aerial_il.data.quality.trace import Trace

SAME_SHARE = 0.02  # of the usual distance to the nearest other episode


def repeated(traces: Sequence[Trace]) -> dict[str, str]:
    """Return the name of each episode that repeats an earlier one -> that one's name.

    Two episodes are the same if, in 24 points along them, states and actions are a fiftieth as far apart as each
    episode usually is from the nearest other one.

    Args:
        traces: normalised.
    """
    if len(traces) < 2:
        return {}
    points = np.stack([trace.along() for trace in traces]).reshape(len(traces), -1)
    distances, nearest = KDTree(points).query(points, k=2)
    same = distances[:, 1] <= SAME_SHARE * np.median(distances[:, 1])
    found = dict[str, str]()
    for i in np.flatnonzero(same).tolist():
        other = next(int(k) for k in np.asarray(nearest)[i] if k != i)
        if other < i:
            found[traces[i].uid] = traces[other].uid
    return found

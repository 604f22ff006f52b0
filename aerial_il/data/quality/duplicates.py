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
    tree = KDTree(points)
    distances, _ = tree.query(points, k=2)
    near: Sequence[list[int]] = tree.query_ball_point(points, SAME_SHARE * float(np.median(distances[:, 1])))  # type: ignore[assignment]
    earlier = {i: min(others) for i, others in enumerate(near) if min(others) < i}
    return {traces[i].uid: traces[other].uid for i, other in earlier.items()}

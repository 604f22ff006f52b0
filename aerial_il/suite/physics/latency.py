"""Actions that arrive late: a queue per world, kept in the simulator's state."""

from __future__ import annotations

from aerial_il.core.kernels import kernel

MAX_DELAY = 2  # control steps
MAX_ACTION = 16  # numbers of the longest action


@kernel
def exchange(delays, queues, actions, active, due):
    """Take in the actions that are sent and hand out those that arrive.

    Args:
        delays: (n,) control steps that an action takes, integers from 0 to MAX_DELAY.
        queues: (n, MAX_DELAY * MAX_ACTION) actions on their way, the next one to arrive first; changed in place.
        actions: (n, Da) sent now. active: (n,) bool, the worlds that move.
        due: (n, Da) written, the actions sent ``delay`` control steps ago.
    """
    for i in range(active.size):
        waiting = int(delays[i]) if active[i] else 0
        for k in range(actions.shape[1]):
            due[i, k] = queues[i, k] if waiting > 0 else actions[i, k]
            for j in range(waiting):
                later = (j + 1) * MAX_ACTION + k
                queues[i, j * MAX_ACTION + k] = queues[i, later] if j + 1 < waiting else actions[i, k]

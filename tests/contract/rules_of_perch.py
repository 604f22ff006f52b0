"""What the instruction about the bar asks for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from tests.contract.placed import ALL, NONE, SOME, Placed, Scatter, Stage, ball, disc, up
from tests.contract.rules_of_long_tasks import Offsets

# perch: "Grip the bar, stop the rotors and stand on it for five seconds; then let go and fly off."


def flown_off(placed: Placed) -> np.ndarray:
    """It has stood for long enough, and hovers a quarter of a metre over the bar without touching a thing."""
    parts = ("base", "palm", "finger_left", "finger_right")
    free = np.array([not any(a in parts or a.startswith("link_") for a, _ in pairs) for pairs in placed.pairs])
    high = placed.tool[:, 2] - placed.pos("perch")[:, 2] >= 0.25
    slow = np.linalg.norm(placed.vel("base"), axis=1) <= 0.15
    return (placed.task_state[:, 1] == 1.0) & free & high & slow


def tool_at(
    off: Offsets, *, stood: float = 1.0, steps: float = 0.0, speed: tuple[float, float] = (0.0, 0.0)
) -> Scatter:
    """Put the tool ``off`` (k, 3) from the bar's middle; ``stood``: 1 if it has been perched for long enough."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        bar, _ = stage.where(rows, "perch")
        stage.move(rows, "tool", bar + off(rng, rows.size))
        stage.qvel[rows, :3] = ball(rng, rows.size, *speed)
        stage.task_state[rows, 0], stage.task_state[rows, 1] = steps, stood

    return place


def over(low: float, high: float) -> Offsets:
    return lambda rng, k: disc(rng, k, 0.0, 0.3) + up(rng.uniform(low, high, k))


def on_bar(rng: np.random.Generator, k: int) -> np.ndarray:
    return np.stack([rng.uniform(-0.05, 0.05, k), np.zeros(k), rng.uniform(-0.03, 0.0, k)], axis=1)


PERCHED = {
    "over the bar": (ALL, tool_at(over(0.2501, 0.8))),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "over it, but it has never stood": (NONE, tool_at(over(0.2501, 0.8), stood=0.0)),
    "over it, and has stood for almost long enough": (NONE, tool_at(over(0.2501, 0.8), stood=0.0, steps=249.0)),
    "still on the bar": (NONE, tool_at(on_bar)),
    "still near it": (NONE, tool_at(over(0.0, 0.2499))),
    "at the least height": (SOME, tool_at(over(0.24, 0.26))),
    "flies past": (NONE, tool_at(over(0.2501, 0.8), speed=(0.1501, 2.0))),
    "hardly moves": (SOME, tool_at(over(0.2501, 0.8), speed=(0.14, 0.16))),
    "under it": (NONE, tool_at(over(-0.4, -0.05))),
}

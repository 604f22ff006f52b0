"""What the instruction about the fruit asks for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from tests.contract.placed import ALL, ANY, NONE, SOME, Placed, Scatter, Stage, ball, disc, level, up, with_robot
from tests.contract.rules_of_long_tasks import Offsets, both, raised

# harvest_fruit: "Pull a red fruit off its stem and drop it in the blue basket; leave the green ones on theirs."

RIPE, UNRIPE = ("ripe_a", "ripe_b"), ("unripe_a", "unripe_b")


def fruit_in_basket(placed: Placed) -> np.ndarray:
    """A red one, off its stem, lies between the basket's walls, let go and at rest; no green one has been torn off."""
    there = np.zeros(len(placed.tool), bool)
    for k, name in enumerate(RIPE):
        away = placed.pos(name) - placed.pos("basket")
        lies = (level(away) <= 0.055) & (away[:, 2] >= 0.024) & (away[:, 2] <= 0.05)
        still = np.linalg.norm(placed.vel(name), axis=1) <= 0.05
        backed_off = np.linalg.norm(placed.pos(name) - placed.tool, axis=1) >= 0.10
        off = placed.task_state[:, k] == 1.0
        there |= lies & still & backed_off & off & ~placed.robot_on(name)
    return there & (placed.task_state[:, 2:4] == 0.0).all(axis=1) & placed.untouched


def lying(rng: np.random.Generator, k: int) -> np.ndarray:
    return disc(rng, k, 0.0, 0.0549) + up(rng.uniform(0.0245, 0.0495, k))


def fruit_at(
    off: Offsets, name: str = "ripe_a", *, stem: float = 1.0, speed: tuple[float, float] = (0.0, 0.0)
) -> Scatter:
    """Put a fruit ``off`` (k, 3) from the basket; ``stem``: 1 if it is broken."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        basket, _ = stage.where(rows, "basket")
        raised(stage, rows, rng)
        stage.free(rows, name, basket + off(rng, rows.size), vel=ball(rng, rows.size, *speed))
        stage.task_state[rows, (*RIPE, *UNRIPE).index(name)] = stem

    return place


def torn(name: str) -> Scatter:
    """Break the stem of a fruit that stays where it is."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        stage.task_state[rows, (*RIPE, *UNRIPE).index(name)] = 1.0

    return place


def edges(rng: np.random.Generator, k: int) -> np.ndarray:
    heights = rng.choice([0.024, 0.035, 0.05], k) + rng.normal(0.0, 1e-3, k)
    return disc(rng, k, 0.053, 0.057) * rng.choice([0.5, 1.0], (k, 1)) + up(heights)


FRUIT = {
    "one in the basket": (ALL, fruit_at(lying)),
    "the other one in the basket": (ALL, fruit_at(lying, "ripe_b")),
    "both ripe ones in the basket": (ALL, both(fruit_at(lying), fruit_at(lying, "ripe_b"))),
    "none picked": (NONE, raised),
    "in the basket, but still on its stem": (NONE, fruit_at(lying, stem=0.0)),
    "an unripe one in the basket": (NONE, fruit_at(lying, "unripe_a")),
    "a ripe and an unripe one in the basket": (NONE, both(fruit_at(lying), fruit_at(lying, "unripe_b"))),
    "an unripe one torn off": (NONE, both(fruit_at(lying), torn("unripe_b"))),
    "off its stem, in its calyx": (NONE, both(raised, torn("ripe_a"))),
    "beside the basket": (NONE, fruit_at(lambda rng, k: disc(rng, k, 0.0551, 0.4) + up(rng.uniform(0.0, 0.06, k)))),
    "over it, on its rim": (NONE, fruit_at(lambda rng, k: disc(rng, k, 0.0, 0.09) + up(rng.uniform(0.0501, 0.6, k)))),
    "under it": (NONE, fruit_at(lambda rng, k: disc(rng, k, 0.0, 0.055) + up(rng.uniform(-0.4, 0.0239, k)))),
    "at the edges of what counts": (SOME, fruit_at(edges)),
    "moving": (NONE, fruit_at(lying, speed=(0.0501, 2.0))),
    "hardly moving": (SOME, fruit_at(lying, speed=(0.045, 0.055))),
    "in the gripper": (NONE, with_robot(fruit_at(lying), "tool", "ripe_a", 0.0, 0.09)),
    "gripper near": (ANY, with_robot(fruit_at(lying), "tool", "ripe_a", 0.08, 0.16)),
    "held down by a link": (NONE, with_robot(fruit_at(lying), "link_1", "ripe_a", 0.0, 0.01)),
}

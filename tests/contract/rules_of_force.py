"""What instructions ask for that take a force to do, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from aerial_il.suite.physics import episode_state as layout
from tests.contract.placed import ALL, NONE, SOME, Placed, Scatter, Stage, ball, with_robot

# wipe_window: "Wipe the brown dirt off the window with the closed gripper, pressing with five newtons."

CELLS, PATCHES = 44, 14


def window_clean(placed: Placed) -> np.ndarray:
    """Of 14 patches one is left at most, and the pane has not been broken."""
    left = np.array([f"{int(bits):b}".count("1") for bits in placed.task_state[:, 1]])
    return (left <= 1) & (placed.task_state[:, 2] == 0.0) & placed.untouched


def dirt_left(patches: tuple[int, int], *, broken: float = 0.0, pressed: float = 0.0) -> Scatter:
    """Leave from so many to so many patches, on a pane that is whole or not, pressed with ``pressed`` N."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        for row in rows:
            count = rng.integers(patches[0], patches[1] + 1)
            stage.task_state[row, 1] = float(sum(1 << int(cell) for cell in rng.choice(CELLS, count, replace=False)))
        stage.task_state[rows, 2] = broken
        stage.userdata[rows, layout.FORCES.start : layout.FORCES.start + 3] = ball(rng, rows.size, pressed, pressed)

    return place


WINDOW = {
    "clean": (ALL, dirt_left((0, 1))),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "pressed, not wiped": (NONE, dirt_left((14, 14), pressed=5.0)),
    "half clean": (NONE, dirt_left((2, 13))),
    "hardly clean": (SOME, dirt_left((0, 3))),
    "clean, and broken": (NONE, dirt_left((0, 1), broken=1.0)),
    "leaning on it with a link": (NONE, with_robot(dirt_left((0, 1)), "link_1", "pane", 0.0, 0.004)),
    "leaning on it with the last link": (NONE, with_robot(dirt_left((0, 1)), "link_3", "pane", 0.0, 0.004)),
}


# screw_bulb: "Grip the bulb by its flats and screw it into the socket, two turns clockwise."

TWO_TURNS, DEEP_M, STOP = 4.0 * np.pi, 0.0072, 4.0 * np.pi + 0.7


def bulb_screwed_in(placed: Placed) -> np.ndarray:
    """Two turns round and as deep as two turns of thread are, in the thread and not through its stop."""
    depth = np.einsum("ni,ni->n", placed.pos("socket") - placed.pos("bulb"), placed.mat("socket")[:, :, 2])
    turned = placed.joint("bulb_turn")
    in_thread = np.abs(depth - turned * DEEP_M / TWO_TURNS) <= 0.0004
    deep = depth >= DEEP_M - 0.0004
    return (turned >= TWO_TURNS) & (turned <= STOP) & deep & in_thread & placed.untouched


def bulb_at(turned: tuple[float, float], off_m: tuple[float, float] = (0.0, 0.0003), speed: float = 0.0) -> Scatter:
    """Turn the lamp, rad, and put it ``off_m`` m higher or lower than its thread has it."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        angle, sign = rng.uniform(*turned, rows.size), rng.choice([-1.0, 1.0], rows.size)
        stage.joint(rows, "bulb_turn", angle, rng.uniform(-speed, speed, rows.size))
        stage.joint(rows, "bulb_travel", angle * DEEP_M / TWO_TURNS + sign * rng.uniform(*off_m, rows.size))

    return place


IN_THREAD = (TWO_TURNS + 0.01, STOP - 0.01)
BULB = {
    "screwed in": (ALL, bulb_at(IN_THREAD)),
    "screwed in, and turning": (ALL, bulb_at(IN_THREAD, speed=1.0)),
    "loose, or out again": (NONE, bulb_at((-0.3, TWO_TURNS - 1e-6))),
    "through its stop": (NONE, bulb_at((STOP + 1e-6, STOP + 3.0))),
    "turned over a stripped thread": (NONE, bulb_at(IN_THREAD, off_m=(0.00041, 0.008))),
    "pushed in without a turn": (NONE, bulb_at((0.0, 0.6), off_m=(0.0065, 0.0075))),
    "nearly two turns": (SOME, bulb_at((TWO_TURNS - 0.1, TWO_TURNS + 0.1))),
    "near its stop": (SOME, bulb_at((STOP - 0.05, STOP + 0.05))),
    "hardly in its thread": (SOME, bulb_at(IN_THREAD, off_m=(0.0003, 0.0005))),
    "held by a link": (NONE, with_robot(bulb_at(IN_THREAD), "link_1", "bulb", 0.0, 0.004)),
    "held by the base": (NONE, with_robot(bulb_at(IN_THREAD), "base", "bulb", 0.0, 0.004)),
}

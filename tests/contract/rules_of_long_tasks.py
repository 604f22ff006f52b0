"""What the instructions of long tasks ask for, and placements that fulfil or miss it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.contract.placed import (
    ALL,
    ANY,
    NONE,
    SOME,
    Placed,
    Scatter,
    Stage,
    about,
    angle_deg,
    ball,
    disc,
    level,
    turned,
    up,
    with_robot,
)
from tests.contract.rules_of_objects import inserted, joint_at, peg_at

Offsets = Callable[[np.random.Generator, int], np.ndarray]


def both(*scatters: Scatter) -> Scatter:
    """Do one after the other."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        for scatter in scatters:
            scatter(stage, rows, rng)

    return place


def raised(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
    """The robot is out of the way."""
    stage.qpos[rows, 2] += 0.3


def quats(mats: np.ndarray) -> np.ndarray:
    """(k, 4) of rotations (k, 3, 3)."""
    w = 0.5 * np.sqrt(np.maximum(1.0 + np.trace(mats, axis1=1, axis2=2), 1e-9))
    x, y, z = (mats[:, (i + 2) % 3, (i + 1) % 3] - mats[:, (i + 1) % 3, (i + 2) % 3] for i in range(3))
    return np.stack([w, x / (4.0 * w), y / (4.0 * w), z / (4.0 * w)], axis=1)


# sort_pegs: "Insert each peg into the socket of its colour, in the order that the lamps show from left to right."

COLOURS = ("red", "green", "blue")
IN, SPOILED = slice(3, 6), 7


def pegs_sorted(placed: Placed) -> np.ndarray:
    """Each is in the hole of its own colour, and none has ever been inserted wrongly or out of turn."""
    there = np.all([inserted(placed, f"peg_{name}", f"hole_{name}") for name in COLOURS], axis=0)
    noted = (placed.task_state[:, IN] == 1.0).all(axis=1) & (placed.task_state[:, SPOILED] == 0.0)
    return there & noted & placed.untouched


def memory(*values: float) -> Scatter:
    """What the episode remembers: whether each peg is in, and whether it is spoiled."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        stage.task_state[rows, 3:6], stage.task_state[rows, SPOILED] = values[:3], values[3]

    return place


DEEP, MIDDLE, STRAIGHT = (0.0301, 0.0479), (0.0, 0.0019), (0.0, 2.0)


def sorted_but(**changed: Scatter) -> Scatter:
    """All three where they belong, but for some colours."""
    homes = {name: peg_at(f"hole_{name}", DEEP, MIDDLE, STRAIGHT, f"peg_{name}") for name in COLOURS}
    return both(raised, memory(1.0, 1.0, 1.0, 0.0), *(homes | changed).values())


def into(peg: str, socket: str, depth: tuple[float, float] = DEEP, off: tuple[float, float] = MIDDLE) -> Scatter:
    return peg_at(socket, depth, off, STRAIGHT, f"peg_{peg}")


SORTED = {
    "all in their holes": (ALL, sorted_but()),
    "two exchanged": (NONE, sorted_but(red=into("red", "hole_blue"), blue=into("blue", "hole_red"))),
    "one in its stand": (NONE, sorted_but(green=into("green", "stand_green", (0.0, 0.036)))),
    "one not far enough": (NONE, sorted_but(blue=into("blue", "hole_blue", (-0.3, 0.0299)))),
    "one through the bottom": (NONE, sorted_but(red=into("red", "hole_red", (0.0481, 0.4)))),
    "one beside its hole": (NONE, sorted_but(red=into("red", "hole_red", DEEP, (0.0041, 0.2)))),
    "one at the edge of depth": (SOME, sorted_but(green=into("green", "hole_green", (0.028, 0.032)))),
    "one inserted before its turn": (NONE, both(sorted_but(), memory(1.0, 1.0, 1.0, 1.0))),
    "one that never went in": (NONE, both(sorted_but(), memory(1.0, 0.0, 1.0, 0.0))),
    "held down by a link": (NONE, with_robot(sorted_but(), "link_1", "peg_red", 0.0, 0.01)),
}


# cabinet_retrieve: "Open the cabinet, take the orange cube out of it and set it down upright on the white spot."


def cube_set_down(placed: Placed) -> np.ndarray:
    """On the table at the spot, the same face up as in the cabinet, at rest, and let go."""
    away, speed = placed.pos("cube") - placed.pos("spot"), placed.qvel[:, -6:-3]
    lies = (level(away) <= 0.015) & (np.abs(away[:, 2] - 0.02) <= 0.004)
    upright = placed.mat("cube")[:, 2, 2] >= np.cos(np.deg2rad(10.0))
    backed_off = np.linalg.norm(placed.pos("cube") - placed.tool, axis=1) >= 0.10
    still = np.linalg.norm(speed, axis=1) <= 0.02
    return lies & upright & backed_off & still & ~placed.robot_on("cube") & placed.untouched


def cube_at(off: Offsets, lean: tuple[float, float] = (0.0, 9.0), **moving: float) -> Scatter:
    """Put the cube at the spot, ``off`` (k, 3) from it, its top leaning by ``lean`` degrees."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        k = rows.size
        spot, _ = stage.where(rows, "spot")
        (yaw, way), tilt = rng.uniform(-np.pi, np.pi, (2, k)), np.deg2rad(rng.uniform(*lean, k))
        axes = np.stack([np.cos(way), np.sin(way), np.zeros(k)], axis=1)
        leans = [about(axis, angle) for axis, angle in zip(axes, tilt, strict=True)]
        turns = [about(np.array([0.0, 0.0, 1.0]), angle) for angle in yaw]
        raised(stage, rows, rng)
        speed = ball(rng, k, moving.get("slow", 0.0), moving.get("fast", 0.0))
        stage.free(rows, "cube", spot + off(rng, k), quats(np.array(leans) @ np.array(turns)), speed)

    return place


def on_spot(rng: np.random.Generator, k: int) -> np.ndarray:
    return disc(rng, k, 0.0, 0.0149) + up(rng.uniform(0.0165, 0.0235, k))


def edges_of_spot(rng: np.random.Generator, k: int) -> np.ndarray:
    return disc(rng, k, 0.013, 0.017) + up(rng.choice([0.016, 0.02, 0.024], k) + rng.normal(0.0, 5e-4, k))


SET_DOWN = {
    "on the spot": (ALL, cube_at(on_spot)),
    "beside it": (NONE, cube_at(lambda rng, k: disc(rng, k, 0.0151, 0.4) + up(np.full(k, 0.02)))),
    "in the air over it": (NONE, cube_at(lambda rng, k: disc(rng, k, 0.0, 0.015) + up(rng.uniform(0.0241, 0.6, k)))),
    "in the table, on the floor": (
        NONE,
        cube_at(lambda rng, k: disc(rng, k, 0.0, 0.015) + up(rng.uniform(-0.4, 0.0159, k))),
    ),
    "at the edges of the spot": (SOME, cube_at(edges_of_spot)),
    "on another face": (NONE, cube_at(on_spot, (85.0, 180.0))),
    "leaning": (SOME, cube_at(on_spot, (5.0, 15.0))),
    "moving": (NONE, cube_at(on_spot, slow=0.0201, fast=1.0)),
    "hardly moving": (SOME, cube_at(on_spot, slow=0.015, fast=0.025)),
    "in the gripper": (NONE, with_robot(cube_at(on_spot), "tool", "cube", 0.0, 0.09)),
    "gripper near": (ANY, with_robot(cube_at(on_spot), "tool", "cube", 0.08, 0.16)),
    "held down by a link": (NONE, with_robot(cube_at(on_spot), "link_1", "cube", 0.0, 0.01)),
}


# restock: "Open the cabinet, put the three cubes from the table into it and close it again."

CUBES = ("cube_orange", "cube_yellow", "cube_purple")
LOW, HIGH = np.array([-0.16, -0.18, 0.012]), np.array([0.0, 0.18, 0.11])  # of middles, in the cabinet's frame


def cubes_shut_in(placed: Placed) -> np.ndarray:
    """All between the cabinet's walls, under its top, at rest; the door within 5° of closed; the robot on nothing."""
    home, axes = placed.pos("cabinet"), placed.mat("cabinet")
    inside = [np.einsum("nji,nj->ni", axes, placed.pos(name) - home) for name in CUBES]
    within = np.all([((pos >= LOW) & (pos <= HIGH)).all(axis=1) for pos in inside], axis=0)
    still = (np.linalg.norm(placed.qvel[:, -18:].reshape(-1, 3, 2, 3)[:, :, 0], axis=2) <= 0.02).all(axis=1)
    shut = angle_deg(axes, placed.mat("door")) <= 5.0
    robot = [any(a == "base" or a.startswith(("link_", "finger_", "palm")) for a, _ in pairs) for pairs in placed.pairs]
    return within & still & shut & ~np.array(robot)


def cubes_at(low: np.ndarray, high: np.ndarray, count: int = 3, **moving: float) -> Scatter:
    """Put the first ``count`` cubes into the cabinet, between two corners in its frame; the door stays."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        home, axes = stage.where(rows, "cabinet")
        for name in CUBES[:count]:
            pos = home + np.einsum("kij,kj->ki", axes, rng.uniform(low, high, (rows.size, 3)))
            speed = ball(rng, rows.size, moving.get("slow", 0.0), moving.get("fast", 0.0))
            stage.free(rows, name, pos, quats(turned(rng, rows.size, 0.0, 90.0)), speed)

    return place


def door_at(low_deg: float, high_deg: float) -> Scatter:
    return joint_at("door", *np.deg2rad([low_deg, high_deg]))


STOWED, CLOSED = both(raised, cubes_at(LOW + 0.001, HIGH - 0.001)), door_at(0.0, 4.99)
UNDER_FLOOR, OVER_TOP = (LOW * [1, 1, 0] - [0.0, 0.0, 0.4], HIGH * [1, 1, 0] + [0.0, 0.0, 0.0119]), 0.1101
RESTOCKED = {
    "all in, door closed": (ALL, both(STOWED, CLOSED)),
    "door open": (NONE, both(STOWED, door_at(5.01, 100.0))),
    "door hardly closed": (SOME, both(STOWED, door_at(4.0, 6.0))),
    "two in": (NONE, both(raised, cubes_at(LOW + 0.001, HIGH - 0.001, 2), CLOSED)),
    "one on top of the door": (
        NONE,
        both(STOWED, cubes_at(np.array([*LOW[:2], OVER_TOP]), np.array([*HIGH[:2], 0.3]), 1), CLOSED),
    ),
    "one under the cabinet": (NONE, both(STOWED, cubes_at(*UNDER_FLOOR, 1), CLOSED)),
    "one in front of it": (
        NONE,
        both(STOWED, cubes_at(np.array([0.0001, *LOW[1:]]), np.array([0.3, *HIGH[1:]]), 1), CLOSED),
    ),
    "at the edges": (SOME, both(raised, cubes_at(LOW - 0.004, HIGH + 0.004), CLOSED)),
    "moving": (NONE, both(raised, cubes_at(LOW + 0.001, HIGH - 0.001, slow=0.0201, fast=1.0), CLOSED)),
    "a link on the door": (NONE, with_robot(both(STOWED, CLOSED), "link_1", "door", 0.0, 0.004)),
    "the gripper at the door": (ANY, with_robot(both(STOWED, CLOSED), "tool", "door", 0.0, 0.2)),
}

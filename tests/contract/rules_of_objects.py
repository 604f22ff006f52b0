"""What instructions about objects, fixtures and buttons ask for, and placements that fulfil or miss it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerial_il.suite.physics import episode_state as layout
from tests.contract.placed import (
    ALL,
    ANY,
    NONE,
    SOME,
    Placed,
    Scatter,
    Stage,
    anywhere,
    attitudes,
    ball,
    disc,
    level,
    up,
    with_robot,
)

# pick_place: "Pick up the orange cube and place it in the blue bowl."
# pick_moving: "Pick up the orange cube from the moving table and place it in the blue bowl."


def cube_in_bowl(placed: Placed, cube: str = "cube") -> np.ndarray:
    """Within the bowl's walls, on its floor, at rest, and let go: the gripper has backed off."""
    still = np.linalg.norm(placed.vel(cube), axis=1) <= 0.05
    backed_off = np.linalg.norm(placed.pos(cube) - placed.tool, axis=1) >= 0.10
    return within_bowl(placed, cube) & still & backed_off & ~placed.robot_on(cube) & placed.untouched


def within_bowl(placed: Placed, cube: str) -> np.ndarray:
    away = placed.pos(cube) - placed.pos("bowl")
    return (level(away) <= 0.05) & (away[:, 2] >= 0.02) & (away[:, 2] <= 0.05)


def one_cube_in_bowl(cube: str, other: str) -> Callable[[Placed], np.ndarray]:
    """The cube that is meant, and not the other one."""

    def counts(placed: Placed) -> np.ndarray:
        away = placed.pos(other) - placed.pos("bowl")
        other_there = (level(away) <= 0.05) & (away[:, 2] >= 0.0) & (away[:, 2] <= 0.10)
        return cube_in_bowl(placed, cube) & ~other_there

    return counts


def cube_at(off: Callable[[np.random.Generator, int], np.ndarray], cube: str = "cube", **moving: float) -> Scatter:
    """Put a cube into the bowl, ``off`` (k, 3) its origin, in any attitude."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        bowl, _ = stage.where(rows, "bowl")
        speed = ball(rng, rows.size, moving.get("slow", 0.0), moving.get("fast", 0.0))
        stage.qpos[rows, 2] += 0.3  # the robot is out of the way
        stage.free(rows, cube, bowl + off(rng, rows.size), attitudes(rng, rows.size), speed)

    return place


def one_of_two(cube: str, other: str) -> dict[str, tuple[str, Scatter]]:
    """Placements of two cubes of which one is meant."""

    def both(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        for name in (cube, other):
            cube_at(in_the_bowl, name)(stage, rows, rng)

    return {
        "the right one in the bowl": (ALL, cube_at(in_the_bowl, cube)),
        "the wrong one in the bowl": (NONE, cube_at(in_the_bowl, other)),
        "both in the bowl": (NONE, both),
        "anywhere": (ANY, anywhere(cube)),
        "at the edges of what counts": (SOME, cube_at(edges_of_the_bowl, cube)),
        "moving": (NONE, cube_at(in_the_bowl, cube, slow=0.0501, fast=2.0)),
        "in the gripper": (NONE, with_robot(cube_at(in_the_bowl, cube), "tool", cube, 0.0, 0.09)),
    }


def in_the_bowl(rng: np.random.Generator, k: int) -> np.ndarray:
    return disc(rng, k, 0.0, 0.03) + up(rng.uniform(0.026, 0.04, k))


def edges_of_the_bowl(rng: np.random.Generator, k: int) -> np.ndarray:
    heights = rng.choice([0.02, 0.03, 0.05], k) + rng.normal(0.0, 1e-3, k)
    return disc(rng, k, 0.049, 0.051) * rng.choice([0.5, 1.0], (k, 1)) + up(heights)


CUBE = {
    "in the bowl, in any attitude": (ALL, cube_at(in_the_bowl)),
    "anywhere": (ANY, anywhere("cube")),
    "under the bowl, in the table, on the floor": (
        NONE,
        cube_at(lambda rng, k: disc(rng, k, 0.0, 0.05) + up(rng.uniform(-0.4, 0.0199, k))),
    ),
    "beside it": (NONE, cube_at(lambda rng, k: disc(rng, k, 0.0501, 0.4) + up(rng.uniform(0.0, 0.06, k)))),
    "over it, on its rim, in mid-air": (
        NONE,
        cube_at(lambda rng, k: disc(rng, k, 0.0, 0.08) + up(rng.uniform(0.0501, 0.6, k))),
    ),
    "at the edges of what counts": (SOME, cube_at(edges_of_the_bowl)),
    "moving": (NONE, cube_at(in_the_bowl, slow=0.0501, fast=2.0)),
    "hardly moving": (SOME, cube_at(in_the_bowl, slow=0.045, fast=0.055)),
    "in the gripper": (NONE, with_robot(cube_at(in_the_bowl), "tool", "cube", 0.0, 0.09)),
    "gripper as far as it must be": (SOME, with_robot(cube_at(in_the_bowl), "tool", "cube", 0.08, 0.16)),
    "held down by a link": (NONE, with_robot(cube_at(in_the_bowl), "link_1", "cube", 0.0, 0.01)),
    "held down by the base": (NONE, with_robot(cube_at(in_the_bowl), "base", "cube", 0.0, 0.01)),
}


# insert_peg: "Take the orange peg out of its stand and insert it into the blue socket."

MOUTH_M, HALF_SPAN_M = 0.060, 0.050  # the bore's mouth over its underside; from the peg's middle to a nose's centre


def peg_in_socket(placed: Placed) -> np.ndarray:
    return inserted(placed, "peg", "hole") & placed.untouched


def inserted(placed: Placed, peg: str, hole: str) -> np.ndarray:
    """30 mm of the peg's full width are between mouth and bottom of the bore, and it came in by the mouth."""
    middle = placed.pos(peg) - placed.pos(hole) - [0.0, 0.0, MOUTH_M]
    half = HALF_SPAN_M * placed.mat(peg)[:, :, 2]
    half = np.where(half[:, 2:] > 0.0, half, -half)
    low, high = middle - half, middle + half
    share = np.clip(-low[:, 2] / np.maximum(high[:, 2] - low[:, 2], 1e-9), 0.0, 1.0)[:, None]
    at_mouth = low + share * (high - low)
    deep = (low[:, 2] <= -0.030) & (low[:, 2] >= -0.048) & (high[:, 2] > 0.0)
    return deep & (level(low) <= 0.004) & (level(at_mouth) <= 0.004)


def peg_at(
    socket: str, depth: tuple[float, float], off: tuple[float, float], tilt: tuple[float, float], peg: str = "peg"
) -> Scatter:
    """Put a peg's lower nose ``depth`` m below a bore's mouth, ``off`` m beside its axis, leaning by ``tilt`` °."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        mouth, k = stage.where(rows, socket)[0] + [0.0, 0.0, MOUTH_M], rows.size
        lean, way = np.deg2rad(rng.uniform(*tilt, k)), rng.uniform(-np.pi, np.pi, k)
        axis = np.stack([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)], axis=1)
        nose = mouth + disc(rng, k, *off) - up(rng.uniform(*depth, k))
        c, s = np.cos(0.5 * lean), np.sin(0.5 * lean)
        quat = np.stack([c, -s * np.sin(way), s * np.cos(way), 0.0 * way])
        over = rng.random(k) < 0.5  # either end first
        flipped = np.stack([-quat[1], quat[0], quat[3], -quat[2]])  # then half a turn about its own x
        stage.free(rows, peg, nose + HALF_SPAN_M * axis, np.where(over, flipped, quat).T)

    return place


def lying(height: float) -> Scatter:
    """The peg lies at a height, m, under or beside the hole."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        hole, k = stage.where(rows, "hole")[0], rows.size
        pos = hole * [1.0, 1.0, 0.0] + disc(rng, k, 0.0, 0.3) + [0.0, 0.0, height]
        stage.free(rows, "peg", pos, np.tile([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], (k, 1)))

    return place


PEG = {
    "inserted, either end first": (ALL, peg_at("hole", (0.0301, 0.0479), (0.0, 0.0019), (0.0, 2.0))),
    "anywhere": (ANY, anywhere("peg")),
    "not far enough, over the mouth": (NONE, peg_at("hole", (-0.3, 0.0299), (0.0, 0.003), (0.0, 5.0))),
    "through the bottom, in the table, under it": (NONE, peg_at("hole", (0.0481, 0.40), (0.0, 0.003), (0.0, 5.0))),
    "beside the socket, in its wall": (NONE, peg_at("hole", (0.0301, 0.0479), (0.0041, 0.2), (0.0, 2.0))),
    "slanting through its wall": (NONE, peg_at("hole", (0.0301, 0.0479), (0.0, 0.003), (15.0, 89.0))),
    "leaning a little": (SOME, peg_at("hole", (0.0301, 0.0479), (0.0, 0.003), (0.0, 12.0))),
    "at the edges of depth": (SOME, peg_at("hole", (0.028, 0.050), (0.0, 0.003), (0.0, 1.0))),
    "at the edges of the bore": (SOME, peg_at("hole", (0.032, 0.046), (0.003, 0.005), (0.0, 1.0))),
    "in its stand": (NONE, peg_at("stand", (0.0, 0.05), (0.0, 0.003), (0.0, 2.0))),
    "lying on the table": (NONE, lying(0.41)),
    "lying on the floor": (NONE, lying(0.01)),
    "held down by a link": (
        NONE,
        with_robot(peg_at("hole", (0.031, 0.046), (0.0, 0.001), (0.0, 1.0)), "link_1", "peg", 0.0, 0.01),
    ),
}


# Joints: the fixture's moving part is where the instruction wants it, and no link or rotor leans on anything.


def joint_at(name: str, low: float, high: float, speed: float = 0.0) -> Scatter:
    """Set a joint between two values."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        stage.joint(rows, name, rng.uniform(low, high, rows.size), rng.uniform(-speed, speed, rows.size))

    return place


def joint_families(name: str, first: float, last: float, body: str, width: float) -> dict[str, tuple[str, Scatter]]:
    """Placements of a joint that counts from ``first`` to ``last``, whose moving part is ``body``."""
    middle = joint_at(name, first + width, last - width)
    return {
        "there": (ALL, middle),
        "there, and moving": (ALL, joint_at(name, first + width, last - width, speed=1.0)),
        "not yet, or shut again": (NONE, joint_at(name, 0.0, first - 1e-6)),
        "hardly moved": (NONE, joint_at(name, -width, width)),
        "off its stop": (NONE, joint_at(name, last + 1e-6, last + 10 * width)),
        "where it begins to count": (SOME, joint_at(name, first - width, first + width)),
        "where it ceases to": (SOME, joint_at(name, last - width, last + width)),
        "held there by a link": (NONE, with_robot(middle, "link_1", body, 0.0, 0.004)),
        "held there by the last link": (NONE, with_robot(middle, "link_3", body, 0.0, 0.004)),
        "held there by the base": (NONE, with_robot(middle, "base", body, 0.0, 0.004)),
    }


def slider_at_end(placed: Placed) -> np.ndarray:
    """ "Push the orange handle along its rail to the green end": on the last tenth of 25 cm, and not off the rail."""
    along = np.einsum("ni,ni->n", placed.pos("slider") - placed.pos("rail"), placed.mat("rail")[:, :, 0])
    return (along >= 0.100) & (along <= 0.135) & placed.untouched


def lever_at_pin(placed: Placed) -> np.ndarray:
    """ "Pull the lever over to the green pin": the bar is as far over as the pin's end, and not beyond the stop."""
    bar = np.einsum("nji,nj->ni", placed.mat("lever_mount"), placed.mat("lever")[:, :, 2])
    lean, at_rest = np.arctan2(bar[:, 0], bar[:, 2]), -0.35
    return (lean >= at_rest + np.deg2rad(55.0)) & (lean <= at_rest + 1.5) & placed.untouched


def door_open(placed: Placed) -> np.ndarray:
    """ "Open the blue cabinet door": its leaf stands at 60° or more to the cabinet's front, and is on its hinge."""
    leaf = np.einsum("nji,nj->ni", placed.mat("cabinet"), -placed.mat("door")[:, :, 1])
    swing = np.arctan2(leaf[:, 0], -leaf[:, 1])
    return (swing >= np.deg2rad(60.0)) & (swing <= 1.85) & placed.untouched


def spoke_over_mark(placed: Placed) -> np.ndarray:
    """ "Turn it anticlockwise until its yellow spoke is over the green mark": there, or past it up to the stop."""
    spoke = np.einsum("nji,nj->ni", placed.mat("valve_mount"), placed.mat("valve")[:, :, 0])
    turned_by = np.arctan2(spoke[:, 1], spoke[:, 0]) % (2.0 * np.pi)
    return (turned_by >= 1.25 * np.pi) & (turned_by <= 1.25 * np.pi + 0.6) & placed.untouched


# press_button: "Press the red button gently and keep it pressed."


def button_pressed(placed: Placed) -> np.ndarray:
    """The cap is in, the robot holds it there, and nothing was ever pushed with more than 15 N."""
    out = np.einsum("ni,ni->n", placed.pos("button_cap") - placed.pos("button"), placed.mat("button")[:, :, 2])
    travel, felt = 0.015 - out, placed.userdata[:, layout.FORCES]
    gentle, held = felt[:, 3 * layout.MAX_FORCES] <= 15.0, np.linalg.norm(felt[:, :3], axis=1) >= 0.5
    return (travel >= 0.008) & (travel <= 0.021) & gentle & held & placed.untouched


def cap(travel: tuple[float, float], force: tuple[float, float], peak: tuple[float, float]) -> Scatter:
    """Set the cap's travel, m, the robot's force, N, and the largest one so far."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        joint_at("button", *travel)(stage, rows, rng)
        felt = stage.userdata[:, layout.FORCES]
        felt[rows, :3] = ball(rng, rows.size, *force)
        felt[rows, 3 * layout.MAX_FORCES] = rng.uniform(*peak, rows.size)

    return place


IN, PUSH, GENTLE = (0.009, 0.020), (0.6, 5.0), (5.0, 14.9)
BUTTON = {
    "pressed": (ALL, cap(IN, PUSH, GENTLE)),
    "not far enough, or let go again": (NONE, cap((-0.001, 0.00799), PUSH, GENTLE)),
    "torn through its stop": (NONE, cap((0.02101, 0.06), PUSH, GENTLE)),
    "in, but by nobody": (NONE, cap(IN, (0.0, 0.499), GENTLE)),
    "after a blow": (NONE, cap(IN, PUSH, (15.001, 80.0))),
    "where it begins to count": (SOME, cap((0.0075, 0.0085), PUSH, GENTLE)),
    "at the stop": (SOME, cap((0.0205, 0.0215), PUSH, GENTLE)),
    "hardly held": (SOME, cap(IN, (0.4, 0.6), GENTLE)),
    "hardly gentle": (SOME, cap(IN, PUSH, (14.0, 16.0))),
    "pressed with a link": (NONE, with_robot(cap(IN, PUSH, GENTLE), "link_1", "button_cap", 0.0, 0.01)),
    "pressed with the last link": (NONE, with_robot(cap(IN, PUSH, GENTLE), "link_3", "button_cap", 0.0, 0.01)),
    "pressed with the base": (NONE, with_robot(cap(IN, PUSH, GENTLE), "base", "button_cap", 0.0, 0.01)),
}

"""What instructions about loads and balls that swing or fly ask for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.tasks import carry_slung_load, toss_ball
from tests.contract.placed import (
    ALL,
    ANY,
    NONE,
    SOME,
    Placed,
    Scatter,
    Stage,
    about,
    anywhere,
    ball,
    disc,
    level,
    up,
    with_robot,
)

# carry_slung_load: "Lift the orange load by its cable, carry it through the red gate and set it down on the green
# mark."

HALF_M = 0.05  # of the load, whose eye is in the middle of its top


def load_delivered(placed: Placed) -> np.ndarray:
    """On the ground by the mark, at rest, below the tool, after a way through the gate that touched nothing."""
    load, upwards = placed.pos("load"), placed.mat("load")[:, :, 2]
    tip = placed.tool + 0.2 * placed.robot.gripper.finger_length * placed.tool_mat[:, :, 0]
    line = tip - (load + HALF_M * upwards)
    swing = np.rad2deg(np.arctan2(level(line), line[:, 2]))
    standing = np.array([("load", "world") in pairs for pairs in placed.pairs]) & (upwards[:, 2] >= np.cos(np.pi / 18))
    gone_through = (placed.task_state[:, 0] == 1.0) & (placed.task_state[:, 1] == 0.0)
    gate_force = placed.userdata[:, layout.FORCES][:, 3 * layout.MAX_FORCES]
    near = level(load - placed.pos("goal")) <= 0.10
    still = np.linalg.norm(placed.vel("load"), axis=1) <= 0.05
    return near & standing & still & (swing <= 5.0) & gone_through & (gate_force == 0.0) & placed.untouched


def delivered(
    *,
    off: tuple[float, float] = (0.0, 0.095),
    height: float = -0.0002,
    lean: tuple[float, float] = (0.0, 0.0),
    speed: tuple[float, float] = (0.0, 0.045),
    swing: tuple[float, float] = (0.0, 4.8),
    through: float = 1.0,
    cable: float = 0.0,
    force: float = 0.0,
) -> Scatter:
    """Put the load ``off`` m from the mark, ``height`` m over the ground, and the tool over it, ``swing`` ° aside.

    Args:
        lean: °. speed: m/s. through, cable, force: what is remembered of the way: gate passed, and touched.
    """

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        k = rows.size
        goal, _ = stage.where(rows, "goal")
        axis = disc(rng, k, 1.0, 1.0)
        angle = np.deg2rad(rng.uniform(*lean, k))
        quat = np.concatenate([np.cos(0.5 * angle)[:, None], np.sin(0.5 * angle)[:, None] * axis], axis=1)
        upwards = np.array([about(a, x)[:, 2] for a, x in zip(axis, angle, strict=True)])
        lowest = HALF_M * (np.cos(angle) + np.sin(angle))  # leaning over an edge; over a corner it is a little lower
        load = goal + disc(rng, k, *off) + up(lowest + height)
        stage.free(rows, "load", load, quat, ball(rng, k, *speed))
        side, length = np.deg2rad(rng.uniform(*swing, k)), rng.uniform(0.85, 0.99, k)
        over = np.sin(side)[:, None] * disc(rng, k, 1.0, 1.0) + up(np.cos(side))
        tip = load + HALF_M * upwards + length[:, None] * over
        stage.move(rows, "tool", tip + up(np.full(k, 0.2 * stage.robot.gripper.finger_length)))  # it points down
        stage.task_state[rows, carry_slung_load.PASSED] = through
        stage.task_state[rows, carry_slung_load.CABLE_TOUCHED] = cable
        stage.userdata[rows, layout.FORCES.start + 3 * layout.MAX_FORCES] = force

    return place


LOAD = {
    "as asked": (ALL, delivered()),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "beside the mark": (NONE, delivered(off=(0.101, 0.6))),
    "still hanging over it": (NONE, delivered(height=0.02)),
    "fallen over": (NONE, delivered(lean=(15.0, 60.0))),
    "sliding": (NONE, delivered(speed=(0.051, 0.5))),
    "with the tool aside": (NONE, delivered(swing=(5.1, 40.0))),
    "not through the gate": (NONE, delivered(through=0.0)),
    "after a touch of the gate": (NONE, delivered(force=0.3)),
    "after a touch of the gate by the cable": (NONE, delivered(cable=1.0)),
    "at the edge of the mark": (SOME, delivered(off=(0.098, 0.102))),
    "at the edge of rest": (SOME, delivered(speed=(0.048, 0.052))),
    "at the edge of its swing": (SOME, delivered(swing=(4.8, 5.2))),
    "held down by a link": (NONE, with_robot(delivered(), "link_1", "load", 0.0, 0.01)),
}


# toss_ball: "Take the orange ball off its tee and throw it into the blue bin without entering the red circle."


def ball_in_bin(placed: Placed) -> np.ndarray:
    """Between the bin's walls, at rest, touched by nobody; the base has kept out of the circle."""
    away = placed.pos("ball") - placed.pos("bin")
    inside = (level(away) <= 0.15) & (away[:, 2] >= 0.07) & (away[:, 2] <= 0.12)
    still = np.linalg.norm(placed.vel("ball"), axis=1) <= 0.05
    return inside & still & (placed.task_state[:, 0] == 0.0) & ~placed.robot_on("ball") & placed.untouched


def ball_at(
    off: tuple[float, float] = (0.0, 0.12),
    height: tuple[float, float] = (0.085, 0.115),
    *,
    speed: tuple[float, float] = (0.0, 0.045),
    entered: float = 0.0,
) -> Scatter:
    """Put the ball ``off`` m from the bin's axis, ``height`` m over its underside; remember if the base came in."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        k = rows.size
        pos = stage.where(rows, "bin")[0] + disc(rng, k, *off) + up(rng.uniform(*height, k))
        stage.free(rows, "ball", pos, vel=ball(rng, k, *speed))
        stage.task_state[rows, toss_ball.ENTERED] = entered

    return place


def gripped(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
    """In the bin, between closed fingers."""
    for side in ("left", "right"):
        stage.joint(rows, f"finger_{side}", np.full(rows.size, 0.0295))
    with_robot(ball_at(), "tool", "ball", 0.0, 0.0001)(stage, rows, rng)


TOSS = {
    "in the bin": (ALL, ball_at()),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "anywhere": (ANY, anywhere("ball")),
    "beside the bin": (NONE, ball_at(off=(0.151, 1.0), height=(0.0, 0.5))),
    "under it, in its floor": (NONE, ball_at(height=(-0.1, 0.0699))),
    "over it": (NONE, ball_at(height=(0.121, 1.5))),
    "moving": (NONE, ball_at(speed=(0.051, 3.0))),
    "after the base was in the circle": (NONE, ball_at(entered=1.0)),
    "at the edge of the bin": (SOME, ball_at(off=(0.145, 0.155))),
    "at the edges of height": (SOME, ball_at(height=(0.115, 0.125))),
    "at the edge of rest": (SOME, ball_at(speed=(0.045, 0.055))),
    "in the gripper": (NONE, gripped),
    "held down by a link": (NONE, with_robot(ball_at(), "link_1", "ball", 0.0, 0.01)),
}

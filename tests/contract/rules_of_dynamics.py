"""What instructions about loads and balls that swing or fly ask for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.tasks import carry_slung_load
from tests.contract.placed import (
    ALL,
    NONE,
    SOME,
    Placed,
    Scatter,
    Stage,
    about,
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

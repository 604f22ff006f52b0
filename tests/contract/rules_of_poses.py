"""What instructions about poses, paths and landings ask for, and placements that fulfil or miss it."""

from __future__ import annotations

import numpy as np

from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks import land, track
from tests.contract.placed import (
    ALL,
    NONE,
    SOME,
    WORLDS,
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

DT_S = 0.02

# inspect_contact: "Press the closed gripper squarely onto the blue spot with five newtons and hold it still."


def probe_on_spot(placed: Placed) -> np.ndarray:
    """Over the spot, square, closed, in contact, 3 to 7 N in each of the five readings, and hardly slid."""
    out, ahead = placed.mat("plate")[:, :, 2], placed.tool_mat[:, :, 0]
    tip = placed.tool + 0.2 * placed.robot.gripper.finger_length * ahead
    spot = placed.pos("plate") + 0.005 * out

    def along_plate(vectors: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.cross(vectors, out), axis=1)

    readings = placed.userdata[:, layout.SAMPLES].reshape(-1, layout.SUBSTEPS, 6)[:, :, :3]
    pressed = -np.einsum("nti,ni->nt", readings, out)
    off_square = np.rad2deg(np.arccos(np.clip(-np.einsum("ni,ni->n", out, ahead), -1.0, 1.0)))
    touching, began = placed.task_state[:, 3] > 0.0, placed.task_state[:, :3]
    return (
        (along_plate(tip - spot) <= 0.04) & (off_square <= 5.0) & (placed.opening <= 0.2) & touching
        & ((pressed >= 3.0) & (pressed <= 7.0)).all(axis=1) & (along_plate(tip - began) <= 0.02) & placed.untouched
    )  # fmt: skip


def probe(
    *,
    off: tuple[float, float] = (0.0, 0.035),
    tilt: tuple[float, float] = (0.0, 4.5),
    force: tuple[float, float] = (3.1, 6.9),
    spike: float | None = None,
    slid: tuple[float, float] = (0.0, 0.019),
    touched: float = 1.0,
    opening: tuple[float, float] = (0.0, 0.1),
) -> Scatter:
    """Bring the probe over the spot: m beside it, ° off square, N, m slid, share of the gripper's stroke."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        k, grip = rows.size, stage.robot.gripper
        for side in ("left", "right"):
            stage.joint(rows, f"finger_{side}", grip.stroke * rng.uniform(*opening, k))
        plate, mat = stage.where(rows, "plate")
        in_plane, out = disc(rng, k, *off), mat[:, :, 2]
        square = np.stack([-out, mat[:, :, 1], np.cross(-out, mat[:, :, 1])], axis=2)
        lean = np.deg2rad(rng.uniform(*tilt, k))
        turn = np.array([about(np.cross(o, a), x) for o, a, x in zip(out, ball(rng, k, 1.0, 1.0), lean, strict=True)])
        tool = np.einsum("nij,njk->nik", turn, square)
        tip = plate + 0.004 * out + np.einsum("nij,nj->ni", mat, in_plane)
        stage.pose(rows, tip - 0.2 * grip.finger_length * tool[:, :, 0], tool)
        pressed = rng.uniform(*force, (k, layout.SUBSTEPS))
        if spike is not None:
            pressed[np.arange(k), rng.integers(layout.SUBSTEPS, size=k)] = spike
        sideways = np.einsum("nij,ntj->nti", mat, rng.normal(0.0, 1.0, (k, layout.SUBSTEPS, 3)) * [1.0, 1.0, 0.0])
        samples = stage.userdata[:, layout.SAMPLES].reshape(WORLDS, layout.SUBSTEPS, 6)
        samples[rows, :, :3] = sideways - pressed[:, :, None] * out[:, None]
        stage.task_state[rows, :3] = tip + np.einsum("nij,nj->ni", mat, disc(rng, k, *slid))
        stage.task_state[rows, 3] = touched

    return place


PROBE = {
    "as asked": (ALL, probe()),
    "beside the spot": (NONE, probe(off=(0.0401, 0.3))),
    "slanting": (NONE, probe(tilt=(5.01, 60.0))),
    "from behind": (NONE, probe(tilt=(120.0, 180.0))),
    "too weak": (NONE, probe(force=(-1.0, 2.99))),
    "too strong": (NONE, probe(force=(7.01, 40.0))),
    "as asked but for a moment": (NONE, probe(spike=7.3)),
    "let go for a moment": (NONE, probe(spike=0.0)),
    "slid away": (NONE, probe(slid=(0.0201, 0.2))),
    "not in contact": (NONE, probe(touched=0.0)),
    "with the gripper open": (NONE, probe(opening=(0.21, 1.0))),
    "at the edge of the spot": (SOME, probe(off=(0.039, 0.041), tilt=(0.0, 1.0))),
    "hardly square": (SOME, probe(tilt=(4.8, 5.2))),
    "hardly five newtons": (SOME, probe(force=(2.8, 4.0))),
    "hardly still": (SOME, probe(slid=(0.0195, 0.0205))),
    "hardly closed": (SOME, probe(opening=(0.15, 0.25))),
    "with a link": (NONE, with_robot(probe(), "link_1", "plate", 0.0, 0.004)),
}


# reach: "Bring the gripper to the marked pose and hold it there."


def tool_at_mark(placed: Placed) -> np.ndarray:
    """Within 2 cm and 10°."""
    near = np.linalg.norm(placed.tool - placed.pos("target"), axis=1) <= 0.02
    return near & (angle_deg(placed.tool_mat, placed.mat("target")) <= 10.0) & placed.untouched


def tool_off(off: tuple[float, float], tilt: tuple[float, float]) -> Scatter:
    """Bring the tool to ``off`` m from the mark, turned by ``tilt`` ° about any axis."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        pos, mat = stage.where(rows, "target")
        mats = np.einsum("nij,njk->nik", turned(rng, rows.size, *tilt), mat)
        stage.pose(rows, pos + ball(rng, rows.size, *off), mats)

    return place


REACH = {
    "there": (ALL, tool_off((0.0, 0.0199), (0.0, 9.9))),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "near, over, under, behind": (NONE, tool_off((0.0201, 0.3), (0.0, 9.9))),
    "turned away": (NONE, tool_off((0.0, 0.0199), (10.1, 90.0))),
    "upside down": (NONE, tool_off((0.0, 0.0199), (170.0, 180.0))),
    "at the edge of position": (SOME, tool_off((0.019, 0.021), (0.0, 9.0))),
    "at the edge of attitude": (SOME, tool_off((0.0, 0.01), (9.5, 10.5))),
}


# hover: "Hover at the marked point, facing along the arrow."


def base_at_mark(placed: Placed) -> np.ndarray:
    """Within 5 cm, and 3° of level along the arrow: there is no wind to lean against."""
    near = np.linalg.norm(placed.pos("base") - placed.pos("target"), axis=1) <= 0.05
    return near & (angle_deg(placed.mat("base"), placed.mat("target")) <= 3.0) & placed.untouched


def base_off(off: tuple[float, float], tilt: tuple[float, float]) -> Scatter:
    """Bring the base to ``off`` m from the mark, turned by ``tilt`` ° about any axis."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        pos, mat = stage.where(rows, "target")
        stage.turn(rows, np.einsum("nij,njk->nik", turned(rng, rows.size, *tilt), mat))
        stage.qpos[rows, :3] = pos + ball(rng, rows.size, *off)

    return place


def hardly_level(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
    """At the mark, off its attitude by a little less or more than 3°.

    The task adds up errors of heading and tilt, whose sum may differ from the angle between the attitudes by 0.04°.
    """
    base_off((0.0, 0.04), (2.5, 2.95))(stage, rows[::2], rng)
    base_off((0.0, 0.04), (3.05, 3.5))(stage, rows[1::2], rng)


def on_the_floor(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
    """At the mark, which lies on the floor."""
    stage.mocap_pos[rows, stage.model.body("target").mocapid[0], 2] = 0.0
    base_off((0.0, 0.01), (0.0, 2.0))(stage, rows, rng)


HOVER = {
    "there": (ALL, base_off((0.0, 0.0499), (0.0, 2.9))),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "near, over, under, behind": (NONE, base_off((0.0501, 0.5), (0.0, 2.9))),
    "leaning, or facing elsewhere": (NONE, base_off((0.0, 0.0499), (3.1, 90.0))),
    "upside down": (NONE, base_off((0.0, 0.0499), (150.0, 180.0))),
    "at the edge of position": (SOME, base_off((0.049, 0.051), (0.0, 2.0))),
    "at the edge of attitude": (SOME, hardly_level),
    "lying on the floor": (NONE, on_the_floor),
}


# track: "Follow the moving green ball closely for one full lap."


def lap_followed(placed: Placed) -> np.ndarray:
    """A full turn of the path in one piece, 3 cm root mean square, and still within 8 cm."""
    lap, rate = placed.task_state[:, track.LAP], np.abs(placed.task_state[:, track.RATE])
    error = np.sqrt(placed.task_state[:, track.SQUARES] / np.maximum(lap / (DT_S * rate), 1.0))
    there = np.linalg.norm(placed.tool - placed.pos("target"), axis=1) <= 0.08
    return (lap >= 2.0 * np.pi) & (error <= 0.03) & there & placed.untouched


def lap(turns: tuple[float, float], rmse: tuple[float, float], off: tuple[float, float]) -> Scatter:
    """Remember a lap of so many turns flown with an error, m; the tool is ``off`` m from the ball."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        angle = 2.0 * np.pi * rng.uniform(*turns, rows.size)
        steps = angle / (DT_S * np.abs(stage.task_state[rows, track.RATE]))
        stage.task_state[rows, track.LAP] = angle
        stage.task_state[rows, track.SQUARES] = steps * rng.uniform(*rmse, rows.size) ** 2
        stage.move(rows, "tool", stage.where(rows, "target")[0] + ball(rng, rows.size, *off))

    return place


LAP = {
    "followed": (ALL, lap((1.001, 1.2), (0.0, 0.0299), (0.0, 0.0799))),
    "not at all": (NONE, lambda stage, rows, rng: None),
    "not the whole lap": (NONE, lap((0.05, 0.999), (0.0, 0.0299), (0.0, 0.0799))),
    "not closely": (NONE, lap((1.001, 1.2), (0.0301, 0.08), (0.0, 0.0799))),
    "lost": (NONE, lap((1.001, 1.2), (0.0, 0.0299), (0.0801, 0.5))),
    "hardly a lap": (SOME, lap((0.99, 1.01), (0.0, 0.02), (0.0, 0.05))),
    "hardly closely": (SOME, lap((1.001, 1.2), (0.029, 0.031), (0.0, 0.05))),
    "hardly there": (SOME, lap((1.001, 1.2), (0.0, 0.02), (0.075, 0.085))),
}


# take_off: "Take off, hover at the marked point and face along the arrow."


def standing_under(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
    """On the skids, straight below the mark and facing along the arrow."""
    pos, mat = stage.where(rows, "target")
    stage.turn(rows, mat)
    stage.qpos[rows, :3] = np.column_stack([pos[:, :2], rng.uniform(STAND_M - 0.001, STAND_M + 0.3, rows.size)])


TAKE_OFF = {**HOVER, "still on the ground, or hardly off it": (NONE, standing_under)}


# land: "Land softly in the middle of the pad."


def on_the_pad(placed: Placed) -> np.ndarray:
    """On its skids within 10 cm of the centre, upright, at rest, its weight put down, and never sinking fast."""
    away, up_axis = placed.pos("base") - placed.pos("pad"), placed.mat("base")[:, 2, 2]
    touches = np.array([any(a == "skids" for a, _ in pairs) for pairs in placed.pairs])
    still = np.linalg.norm(placed.qvel[:, :3], axis=1) <= 0.05
    carried = np.linalg.norm(placed.userdata[:, layout.FORCES.start : layout.FORCES.start + 3], axis=1)
    weight = 9.81 * placed.robot.vehicle.mass
    there = (level(away) <= 0.10) & (up_axis >= np.cos(np.deg2rad(5.0))) & still & touches & placed.untouched
    return there & (carried >= 0.2 * weight) & (placed.task_state[:, land.HARDEST] <= 0.7)


def put_down(
    off: tuple[float, float] = (0.0, 0.09), tilt: tuple[float, float] = (0.0, 0.3), height: float = -0.0005, *,
    speed: tuple[float, float] = (0.0, 0.04), load: tuple[float, float] = (0.3, 1.0),
    hardest: tuple[float, float] = (0.0, 0.69),
) -> Scatter:  # fmt: skip
    """Put the base ``off`` m aside of the pad's centre, its skids at ``height`` m, leaning by ``tilt`` °.

    Args:
        speed: m/s. load: share of the weight that the ground is felt to carry. hardest: remembered touchdown, m/s.
    """

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        k = rows.size
        pad, _ = stage.where(rows, "pad")
        stage.qpos[rows, :3] = pad + disc(rng, k, *off) + up(np.full(k, STAND_M + height))
        stage.turn(rows, turned(rng, k, *tilt))
        stage.qvel[rows, :6] = 0.0
        stage.qvel[rows, :3] = ball(rng, k, *speed)
        force = layout.FORCES.start + 2
        stage.userdata[rows, force] = -9.81 * stage.robot.vehicle.mass * rng.uniform(*load, k)
        stage.task_state[rows, land.HARDEST] = rng.uniform(*hardest, k)

    return place


LAND = {
    "there": (ALL, put_down()),
    "wherever it starts": (NONE, lambda stage, rows, rng: None),
    "beside the pad's centre": (NONE, put_down(off=(0.101, 0.5))),
    "hovering over it": (NONE, put_down(height=0.02)),
    "leaning": (NONE, put_down(tilt=(15.0, 40.0), height=0.02)),
    "upside down": (NONE, put_down(tilt=(165.0, 180.0), height=0.3)),
    "sliding": (NONE, put_down(speed=(0.051, 0.5))),
    "grazing the ground": (NONE, put_down(load=(0.0, 0.19))),
    "after a hard blow": (NONE, put_down(hardest=(0.701, 3.0))),
    "at the edge of the disc": (SOME, put_down(off=(0.098, 0.102))),
    "at the edge of its load": (SOME, put_down(load=(0.18, 0.22))),
    "at the edge of rest": (SOME, put_down(speed=(0.048, 0.052))),
    "at the edge of softness": (SOME, put_down(hardest=(0.69, 0.71))),
}

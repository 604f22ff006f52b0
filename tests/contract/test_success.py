"""Success is what the instruction says, judged a second time from raw positions.

Each task's worlds are put into random states: where the object belongs, and where it does not. A predicate written
here, from the instruction, must agree with the task's own assessment in every one: of 2,000, of 10,000 (slow).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.suite import tasks
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks import land, track

PLACEMENTS, AT_LENGTH, WORLDS = 2_000, 10_000, 100
DT_S = 0.02
ALL, NONE, SOME, ANY = "all", "none", "some", "any"  # of a family's placements count as success; both outcomes occur
Predicate = Callable[["Placed"], np.ndarray]
Scatter = Callable[["Stage", np.ndarray, np.random.Generator], None]


def judged(env: BatchEnvironment) -> np.ndarray:
    """(n,) what the task says of the present states."""
    return measured.truth(env.simulation.task.kernels.solved)(env.simulation.view)


@pytest.mark.parametrize("task", tasks.names())
def test_success_is_what_the_instruction_says(task: str) -> None:
    check(task, judged)


@pytest.mark.slow
@pytest.mark.parametrize("task", tasks.names())
def test_success_is_what_the_instruction_says_at_length(task: str) -> None:
    check(task, judged, AT_LENGTH)


def test_a_judge_who_overlooks_the_floor_is_noticed() -> None:
    def lenient(env: BatchEnvironment) -> np.ndarray:
        cube = env.simulation.view.site_pos("cube")
        beside = np.hypot(*(cube - env.simulation.view.site_pos("bowl"))[:, :2].T)
        return judged(env) | ((beside <= 0.05) & (cube[:, 2] < 0.3))

    with pytest.raises(AssertionError, match="under the bowl"):
        check("pick_place", lenient)


def test_a_task_without_a_rule_is_refused_with_what_to_write() -> None:
    with pytest.raises(AssertionError, match="juggle has no rule here"):
        check("juggle", judged)


def check(task: str, judge: Callable[[BatchEnvironment], np.ndarray], placements: int = PLACEMENTS) -> None:
    """Compare a judge with the task's rule on all placements.

    Raises:
        AssertionError: there is no rule, they differ, or the placements try nothing.
    """
    assert task in RULES, (
        f"{task} has no rule here. Add one to RULES: a predicate over raw positions that says what its instruction "
        "asks for, and families of placements that fulfil it, that miss it, and that lie on either side of each limit."
    )
    rule, stage, rng = RULES[task], Stage(task), np.random.default_rng(1)
    count: dict[str, list[np.ndarray]] = {name: [] for name in rule.families}
    for round_ in range(placements // WORLDS):
        placed = stage.scatter(rule.families, 1000 * round_, rng)
        expected, result = rule.predicate(placed), judge(stage.env)
        for k, name in enumerate(rule.families):
            rows = stage.family == k
            wrong = rows & (expected != result)
            assert not wrong.any(), f"{name}: the task says {result[wrong][0]}, the instruction {expected[wrong][0]}"
            count[name].append(expected[rows])
    for name, (outcome, _) in rule.families.items():
        share = np.concatenate(count[name]).mean()
        right = {ALL: share == 1.0, NONE: share == 0.0, SOME: 0.05 < share < 0.95, ANY: True}
        assert right[outcome], f"{name}: {100 * share:.1f} % count, expected: {outcome}"


@dataclass(frozen=True)
class Rule:
    """What a task's instruction asks for, and placements to try it on: name -> (expected outcome, how to place)."""

    predicate: Predicate
    families: Mapping[str, tuple[str, Scatter]]


class Stage:
    """Worlds of a task whose states are written by hand.

    Attributes:
        family: (n,) which family each world belongs to.
    """

    def __init__(self, task: str) -> None:
        able = [robot for robot, other in aerial_il.list_cells() if other == task]
        self.robot = robots.get("fa_hexa_arm4" if "fa_hexa_arm4" in able else able[0])
        self.env = aerial_il.load_batch(self.robot.name, task, num_envs=WORLDS, num_threads=1)
        self.worlds = self.env.simulation.worlds
        self.model = self.worlds.model
        self.qpos, self.qvel = self.worlds.bind("qpos"), self.worlds.bind("qvel")
        self.userdata, self.mocap_pos = self.worlds.bind("userdata"), self.worlds.bind("mocap_pos")
        self.task_state = self.userdata[:, layout.TASK]
        self.family = np.zeros(WORLDS, int)

    def scatter(self, families: Mapping[str, tuple[str, Scatter]], seed: int, rng: np.random.Generator) -> Placed:
        """Start episodes, change each as one of the families says, and look."""
        self.env.reset(seed)
        self.family = np.arange(WORLDS) % len(families)
        for k, (_, place) in enumerate(families.values()):
            place(self, np.flatnonzero(self.family == k), rng)
        return self.look()

    def look(self) -> Placed:
        """Make everything that follows from the written states current: contacts and sensors too."""
        sensors = self.worlds.bind("sensordata")
        self.worlds.forward()
        for i in range(WORLDS):
            mujoco.mj_forward(self.model, self.worlds.data(i))
            sensors[i] = self.worlds.data(i).sensordata
        return Placed(self)

    def joint(self, rows: np.ndarray, name: str, values: np.ndarray, speed: np.ndarray | float = 0.0) -> None:
        """Set a hinge or slide joint."""
        joint = self.model.joint(name)
        self.qpos[rows, joint.qposadr[0]], self.qvel[rows, joint.dofadr[0]] = values, speed

    def free(
        self,
        rows: np.ndarray,
        name: str,
        pos: np.ndarray,
        quat: np.ndarray | None = None,
        vel: np.ndarray | float = 0.0,
    ) -> None:
        """Put a free body at ``pos`` (k, 3) m, upright or as ``quat`` (k, 4), moving with ``vel`` (k, 3) m/s."""
        joint = self.model.joint(name)
        first, speed = joint.qposadr[0], joint.dofadr[0]
        self.qpos[rows, first : first + 3] = pos
        self.qpos[rows, first + 3 : first + 7] = [1.0, 0.0, 0.0, 0.0] if quat is None else quat
        self.qvel[rows, speed : speed + 6] = 0.0
        self.qvel[rows, speed : speed + 3] = vel

    def move(self, rows: np.ndarray, body: str, pos: np.ndarray) -> None:
        """Shift the whole robot until ``body`` of it, or its ``tool``, is at ``pos`` (k, 3)."""
        self.worlds.forward()
        for row, wanted in zip(rows, pos, strict=True):
            data = self.worlds.data(row)
            now = data.site("tool").xpos if body == "tool" else data.body(body).xpos
            self.qpos[row, :3] += wanted - now

    def pose(self, rows: np.ndarray, pos: np.ndarray, mat: np.ndarray) -> None:
        """Turn and shift the whole robot until its tool is at ``pos`` (k, 3) with attitude ``mat`` (k, 3, 3)."""
        self.worlds.forward()
        for row, wanted in zip(rows, mat, strict=True):
            data, turn, quat = self.worlds.data(row), np.empty(4), np.empty(4)
            mujoco.mju_mat2Quat(turn, (wanted @ data.site("tool").xmat.reshape(3, 3).T).ravel())
            mujoco.mju_mulQuat(quat, turn, self.qpos[row, 3:7])
            self.qpos[row, 3:7] = quat
        self.move(rows, "tool", pos)

    def turn(self, rows: np.ndarray, mats: np.ndarray) -> None:
        """Give the base attitudes (k, 3, 3)."""
        for row, wanted in zip(rows, mats, strict=True):
            mujoco.mju_mat2Quat(self.qpos[row, 3:7], wanted.ravel())

    def where(self, rows: np.ndarray, body: str) -> tuple[np.ndarray, np.ndarray]:
        """Position (k, 3) and attitude (k, 3, 3) of a body as the states stand."""
        self.worlds.forward()
        result = [self.worlds.data(row).body(body) for row in rows]
        return np.array([b.xpos.copy() for b in result]), np.array([b.xmat.reshape(3, 3).copy() for b in result])


class Placed:
    """What is where in n worlds: raw positions, joints, contacts and memory."""

    def __init__(self, stage: Stage) -> None:
        self._stage, self._model = stage, stage.model
        self._datas = [stage.worlds.data(i) for i in range(WORLDS)]
        self.robot = stage.robot
        self.userdata, self.qvel = stage.userdata.copy(), stage.qvel.copy()
        self.task_state = self.userdata[:, layout.TASK]

    def pos(self, body: str) -> np.ndarray:
        """(n, 3)."""
        return np.array([data.body(body).xpos.copy() for data in self._datas])

    def mat(self, body: str) -> np.ndarray:
        """(n, 3, 3)."""
        return np.array([data.body(body).xmat.reshape(3, 3).copy() for data in self._datas])

    @cached_property
    def tool(self) -> np.ndarray:
        """(n, 3)."""
        return np.array([data.site("tool").xpos.copy() for data in self._datas])

    @cached_property
    def tool_mat(self) -> np.ndarray:
        """(n, 3, 3)."""
        return np.array([data.site("tool").xmat.reshape(3, 3).copy() for data in self._datas])

    @cached_property
    def opening(self) -> np.ndarray:
        """(n,) of the gripper, as a share of its stroke."""
        sides = [[data.joint(f"finger_{side}").qpos[0] for side in ("left", "right")] for data in self._datas]
        return np.mean(sides, axis=1) / self.robot.gripper.stroke

    @cached_property
    def pairs(self) -> list[set[tuple[str, str]]]:
        """Names of the bodies that touch, both ways round, in each world."""
        result = []
        for data in self._datas:
            bodies = self._model.geom_bodyid[data.contact.geom]
            named = [(self._model.body(a).name, self._model.body(b).name) for a, b in bodies]
            result.append({*named, *((b, a) for a, b in named)})
        return result

    @property
    def untouched(self) -> np.ndarray:
        """(n,) bool: neither the base nor a link of the arm touches anything."""
        return np.array([not any(a == "base" or a.startswith("link_") for a, _ in pairs) for pairs in self.pairs])

    def robot_on(self, body: str) -> np.ndarray:
        """(n,) bool: some part of the robot touches ``body``."""
        parts = ("base", "palm", "finger_left", "finger_right")
        return np.array(
            [any(b == body and (a in parts or a.startswith("link_")) for a, b in pairs) for pairs in self.pairs]
        )


def disc(rng: np.random.Generator, k: int, low: float, high: float) -> np.ndarray:
    """(k, 3) level vectors of random direction, between ``low`` and ``high`` m long."""
    angle, radius = rng.uniform(-np.pi, np.pi, k), rng.uniform(low, high, k)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(k)], axis=1)


def ball(rng: np.random.Generator, k: int, low: float, high: float) -> np.ndarray:
    """(k, 3) vectors of random direction, between ``low`` and ``high`` long."""
    vectors = rng.standard_normal((k, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None] * rng.uniform(low, high, k)[:, None]


def up(heights: np.ndarray) -> np.ndarray:
    """(k, 3) vertical vectors."""
    return np.stack([np.zeros_like(heights), np.zeros_like(heights), heights], axis=1)


def attitudes(rng: np.random.Generator, k: int) -> np.ndarray:
    """(k, 4) random unit quaternions."""
    quats = rng.standard_normal((k, 4))
    return quats / np.linalg.norm(quats, axis=1)[:, None]


def turned(rng: np.random.Generator, k: int, low_deg: float, high_deg: float) -> np.ndarray:
    """(k, 3, 3) rotations about random axes."""
    axes, angles = ball(rng, k, 1.0, 1.0), np.deg2rad(rng.uniform(low_deg, high_deg, k))
    return np.array([about(axis, angle) for axis, angle in zip(axes, angles, strict=True)]).reshape(k, 3, 3)


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation about an axis (3,) of any length by ``angle`` rad."""
    quat, mat = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quat, axis / np.linalg.norm(axis), angle)
    mujoco.mju_quat2Mat(mat, quat)
    return mat.reshape(3, 3)


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) angles between attitudes (n, 3, 3)."""
    return np.rad2deg(np.arccos(np.clip(0.5 * (np.einsum("nij,nij->n", a, b) - 1.0), -1.0, 1.0)))


def level(vectors: np.ndarray) -> np.ndarray:
    """(n,) horizontal lengths."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


# pick_place: "Pick up the orange cube and place it in the blue bowl."


def cube_in_bowl(placed: Placed) -> np.ndarray:
    """Within the bowl's walls, on its floor, at rest, and let go: the gripper has backed off."""
    away, speed = placed.pos("cube") - placed.pos("bowl"), placed.qvel[:, -6:-3]
    inside = (level(away) <= 0.05) & (away[:, 2] >= 0.02) & (away[:, 2] <= 0.05)
    backed_off = np.linalg.norm(placed.pos("cube") - placed.tool, axis=1) >= 0.10
    still = np.linalg.norm(speed, axis=1) <= 0.05
    return inside & still & backed_off & ~placed.robot_on("cube") & placed.untouched


def cube_at(off: Callable[[np.random.Generator, int], np.ndarray], **moving: float) -> Scatter:
    """Put the cube into the bowl, ``off`` (k, 3) its origin, in any attitude."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        bowl, _ = stage.where(rows, "bowl")
        speed = ball(rng, rows.size, moving.get("slow", 0.0), moving.get("fast", 0.0))
        stage.qpos[rows, 2] += 0.3  # the robot is out of the way
        stage.free(rows, "cube", bowl + off(rng, rows.size), attitudes(rng, rows.size), speed)

    return place


def in_the_bowl(rng: np.random.Generator, k: int) -> np.ndarray:
    return disc(rng, k, 0.0, 0.03) + up(rng.uniform(0.026, 0.04, k))


def with_robot(scatter: Scatter, body: str, at: str, low: float, high: float) -> Scatter:
    """Then bring a part of the robot to within ``low`` to ``high`` m of a body."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        scatter(stage, rows, rng)
        pos, _ = stage.where(rows, at)
        stage.move(rows, body, pos + ball(rng, rows.size, low, high))

    return place


def anywhere(name: str) -> Scatter:
    """Put a free body anywhere in a box about the table, in any attitude."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        pos = rng.uniform([-0.6, -0.7, 0.0], [0.6, 0.7, 1.0], (rows.size, 3))
        stage.free(rows, name, pos, attitudes(rng, rows.size))

    return place


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
    """30 mm of the peg's full width are between mouth and bottom of the bore, and it came in by the mouth."""
    middle = placed.pos("peg") - placed.pos("hole") - [0.0, 0.0, MOUTH_M]
    half = HALF_SPAN_M * placed.mat("peg")[:, :, 2]
    half = np.where(half[:, 2:] > 0.0, half, -half)
    low, high = middle - half, middle + half
    share = np.clip(-low[:, 2] / np.maximum(high[:, 2] - low[:, 2], 1e-9), 0.0, 1.0)[:, None]
    at_mouth = low + share * (high - low)
    deep = (low[:, 2] <= -0.030) & (low[:, 2] >= -0.048) & (high[:, 2] > 0.0)
    return deep & (level(low) <= 0.004) & (level(at_mouth) <= 0.004) & placed.untouched


def peg_at(socket: str, depth: tuple[float, float], off: tuple[float, float], tilt: tuple[float, float]) -> Scatter:
    """Put the peg's lower nose ``depth`` m below a bore's mouth, ``off`` m beside its axis, leaning by ``tilt`` °."""

    def place(stage: Stage, rows: np.ndarray, rng: np.random.Generator) -> None:
        mouth, k = stage.where(rows, socket)[0] + [0.0, 0.0, MOUTH_M], rows.size
        lean, way = np.deg2rad(rng.uniform(*tilt, k)), rng.uniform(-np.pi, np.pi, k)
        axis = np.stack([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)], axis=1)
        nose = mouth + disc(rng, k, *off) - up(rng.uniform(*depth, k))
        c, s = np.cos(0.5 * lean), np.sin(0.5 * lean)
        quat = np.stack([c, -s * np.sin(way), s * np.cos(way), 0.0 * way])
        over = rng.random(k) < 0.5  # either end first
        flipped = np.stack([-quat[1], quat[0], quat[3], -quat[2]])  # then half a turn about its own x
        stage.free(rows, "peg", nose + HALF_SPAN_M * axis, np.where(over, flipped, quat).T)

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


RULES = {
    "hover": Rule(base_at_mark, HOVER),
    "insert_peg": Rule(peg_in_socket, PEG),
    "inspect_contact": Rule(probe_on_spot, PROBE),
    "land": Rule(on_the_pad, LAND),
    "open_door": Rule(door_open, joint_families("door", np.deg2rad(60.0), 1.85, "door", 0.02)),
    "pick_place": Rule(cube_in_bowl, CUBE),
    "press_button": Rule(button_pressed, BUTTON),
    "pull_lever": Rule(lever_at_pin, joint_families("lever", np.deg2rad(55.0), 1.5, "lever", 0.02)),
    "push_slider": Rule(slider_at_end, joint_families("slider", 0.225, 0.26, "slider", 0.002)),
    "reach": Rule(tool_at_mark, REACH),
    "rotate_valve": Rule(spoke_over_mark, joint_families("valve", 1.25 * np.pi, 1.25 * np.pi + 0.6, "valve", 0.02)),
    "take_off": Rule(base_at_mark, TAKE_OFF),
    "track": Rule(lap_followed, LAP),
}

"""Worlds whose states are written by hand, what is where in them, and ways to place things."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import mujoco
import numpy as np

import aerial_il
from aerial_il import robots
from aerial_il.suite.physics import episode_state as layout

WORLDS = 100
ALL, NONE, SOME, ANY = "all", "none", "some", "any"  # of a family's placements count as success; both outcomes occur
Predicate = Callable[["Placed"], np.ndarray]
Scatter = Callable[["Stage", np.ndarray, np.random.Generator], None]


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
        for data, row, wanted in zip(self._datas(rows), rows, pos, strict=True):
            now = data.site("tool").xpos if body == "tool" else data.body(body).xpos
            self.qpos[row, :3] += wanted - now

    def pose(self, rows: np.ndarray, pos: np.ndarray, mat: np.ndarray) -> None:
        """Turn and shift the whole robot until its tool is at ``pos`` (k, 3) with attitude ``mat`` (k, 3, 3)."""
        for data, row, wanted in zip(self._datas(rows), rows, mat, strict=True):
            turn, quat = np.empty(4), np.empty(4)
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
        result = [data.body(body) for data in self._datas(rows)]
        return np.array([b.xpos.copy() for b in result]), np.array([b.xmat.reshape(3, 3).copy() for b in result])

    def _datas(self, rows: np.ndarray) -> list[mujoco.MjData]:
        """Return worlds in which everything is where the written states put it; contacts and sensors follow later."""
        result = [self.worlds.data(row) for row in rows]
        for data in result:
            mujoco.mj_kinematics(self.model, data)
        return result


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

    def vel(self, joint: str) -> np.ndarray:
        """(n, 3) linear velocity of a free joint."""
        first = self._model.joint(joint).dofadr[0]
        return self.qvel[:, first : first + 3]

    def joint(self, name: str) -> np.ndarray:
        """(n,) position of a hinge or slide joint."""
        return np.array([data.joint(name).qpos[0] for data in self._datas])

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

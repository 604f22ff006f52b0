"""Objects of the tasks' scenes, dropped with no robot about: where they come to rest, what went wrong on the way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

import aerial_il
from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.suite import tasks
from aerial_il.suite.scene import build_xml

BASE = "base"
DOWN = np.array([0.0, 0.0, -1.0])
LOWEST_M, HIGHEST_M = 0.05, 1.0  # gap between an object and what lies below it when it is let go
AROUND_M, ASIDE_M = np.array([0.5, 0.6]), 0.08  # where it is let go: about the table, and about each fixture
SETTLING_S = 6.0  # a cube may tip over the rim of the bowl after seconds
PENETRATION_M = 1e-3
WATCHED_S, MOVED_M, TURNED_RAD = 0.5, 0.002, 0.02  # at the end; contacts of boxes flicker, so no speed is asked for
ENERGY_SHARE = 1e-3  # of the energy of the fall: what the integrator may add to a body that tumbles in free air
PLACES = 16  # seeds whose fixtures are dropped upon


@cache
def loose_objects() -> tuple[tuple[str, str], ...]:
    """(task, free joint) of every object that is not the robot."""
    result = []
    for task in tasks.names():
        model = mujoco.MjModel.from_xml_string(build_xml(robots.get(_robot(task)), tasks.get(task)))
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        result += [(task, name) for name in (model.joint(j).name for j in free) if name != BASE]
    return tuple(result)


def props_of(task: str, joint: str) -> mujoco.MjSpec:
    """The scene of a task without its robot, and without other loose objects than that with ``joint``."""
    spec = mujoco.MjSpec.from_string(build_xml(robots.get(_robot(task)), tasks.get(task)))
    for element in (*spec.sensors, *spec.actuators, *spec.tendons, *spec.equalities):
        spec.delete(element)
    for name in (BASE, *(name for where, name in loose_objects() if where == task and name != joint)):
        spec.delete(spec.body(name))
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return spec


@cache
def places_of(task: str) -> tuple[dict[str, np.ndarray], ...]:
    """Where the mocap bodies of a task's scene stand in a few episodes: name -> position and quaternion, (7,)."""
    worlds = aerial_il.load_batch(_robot(task), task, num_envs=PLACES)
    worlds.reset(910_000)
    view, model = worlds.simulation.view, worlds.model
    names = [model.body(int(b)).name for b in np.flatnonzero(model.body_mocapid >= 0)]
    poses = {n: np.hstack([view.mocap_pos[:, view.mocap_id(n)], view.mocap_quat[:, view.mocap_id(n)]]) for n in names}
    worlds.close()
    return tuple({name: poses[name][i] for name in names} for i in range(PLACES))


@dataclass(frozen=True)
class Drop:
    """How one drop ended.

    Attributes:
        gap: between the object and what lay below it at the start, m. energy: the most it ever had beyond that of the
            start, as a share of that of the fall. rebound: of its middle above where it started, after the first
            touch, m. penetration: at rest, m. moved, turned: in the last half second, m and rad.
        passed: it is under what it was let go above, without ever having been beside it.
    """

    gap: float
    energy: float
    rebound: float
    penetration: float
    moved: float
    turned: float
    passed: bool

    @property
    def faults(self) -> tuple[str, ...]:
        """What no real object does."""
        judged = {
            "passed through": self.passed,
            "stuck": self.penetration > PENETRATION_M,
            "not at rest": self.moved > MOVED_M or self.turned > TURNED_RAD,
            "gained energy": self.energy > ENERGY_SHARE,
            "bounced higher than it fell from": self.rebound > 0.0,
        }
        return tuple(name for name, result in judged.items() if result)


def drop(model: mujoco.MjModel, joint: str, places: tuple[dict[str, np.ndarray], ...], seed: int) -> Drop:
    """Let an object go at a random place, height and attitude; ``places``: see :func:`places_of`."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    place = places[seed % len(places)]
    for name, pose in place.items():
        mocap = model.body(name).mocapid[0]
        data.mocap_pos[mocap], data.mocap_quat[mocap] = pose[:3], pose[3:]
    first = model.joint(joint).qposadr[0]
    pose = data.qpos[first : first + 7]
    below, gap = _let_go(model, data, joint, place, rng)
    body, start = model.jnt_bodyid[model.joint(joint).id], pose[:3].copy()
    energy, fall = data.energy.sum(), model.body_mass[body] * GRAVITY * gap
    most, highest, touched, over, before = -np.inf, -np.inf, False, True, pose
    steps, watched = (round(seconds / model.opt.timestep) for seconds in (SETTLING_S, WATCHED_S))
    for k in range(steps):
        mujoco.mj_step(model, data)
        before = pose.copy() if k == steps - watched else before
        touched |= data.ncon > 0
        most = max(most, data.energy.sum() - energy)
        highest = max(highest, pose[2] - start[2]) if touched else highest
        over = over and _below(model, data, body, start[2]) == below
    mujoco.mj_forward(model, data)
    beneath = over and pose[2] < _top(model, data, body, start[2])
    deepest = max([0.0, *(-data.contact.dist[: data.ncon])])
    moved = float(np.linalg.norm(pose[:3] - before[:3]))
    turned = 2.0 * np.arccos(min(1.0, abs(pose[3:] @ before[3:])))
    return Drop(gap, most / fall, highest, deepest, moved, turned, bool(beneath or pose[2] < 0.0))


def _let_go(
    model: mujoco.MjModel, data: mujoco.MjData, joint: str, place: dict[str, np.ndarray], rng: np.random.Generator
) -> tuple[int, float]:
    """Put the object at rest where nothing touches it; return the geom below it and the gap between them, m."""
    body, first = model.jnt_bodyid[model.joint(joint).id], model.joint(joint).qposadr[0]
    geom, pose = model.body_geomadr[body], data.qpos[first : first + 7]
    aims = [np.zeros(2), *(pose[:2] for pose in place.values())]
    while True:
        aim = rng.integers(2) and rng.integers(1, len(aims)) if len(aims) > 1 else 0
        spread = ASIDE_M if aim else AROUND_M
        pose[:2] = aims[aim] + rng.uniform(-1.0, 1.0, 2) * spread
        attitude = rng.standard_normal(4)
        pose[2], pose[3:] = 10.0, attitude / np.linalg.norm(attitude)
        mujoco.mj_kinematics(model, data)
        below, gap = _below(model, data, body, 10.0), rng.uniform(LOWEST_M, HIGHEST_M)
        pose[2] = _top(model, data, body, 10.0) + gap + _reach_down(model, data, geom)
        mujoco.mj_forward(model, data)
        if data.ncon == 0:
            return below, gap


def _reach_down(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """How far a box or capsule reaches below its middle, m."""
    upward, size = data.geom_xmat[geom].reshape(3, 3)[2], model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return float(np.abs(upward) @ size)
    return float(abs(upward[2]) * size[1] + size[0])


def _ray(model: mujoco.MjModel, data: mujoco.MjData, body: int, height: float) -> tuple[int, float]:
    """First geom straight below ``height`` m over the body's middle, and how far down it is, m."""
    first = model.jnt_qposadr[model.body_jntadr[body]]
    result, start = np.zeros(1, np.int32), np.array([*data.qpos[first : first + 2], height])
    distance = mujoco.mj_ray(model, data, start, DOWN, None, True, body, result)
    return int(result[0]), distance


def _below(model: mujoco.MjModel, data: mujoco.MjData, body: int, height: float) -> int:
    return _ray(model, data, body, height)[0]


def _top(model: mujoco.MjModel, data: mujoco.MjData, body: int, height: float) -> float:
    return height - _ray(model, data, body, height)[1]


def _robot(task: str) -> str:
    """A robot that can do the task."""
    return next(robot for robot, other in tasks.cells() if other == task)

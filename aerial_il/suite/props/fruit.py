"""Plants that bear one fruit each, beside a leaf: it sits on its calyx, and its stem holds it there.

The stem is a spring, an actuator whose set-point is one while it is whole; set to zero it pulls no more. The set-point
is in the state, as is what its length follows from, so that a recorded flight breaks it at the same instant again.
"""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING, WORLD
from aerial_il.suite.physics.view import View
from aerial_il.suite.props.contact import HARD
from aerial_il.suite.props.place import place
from aerial_il.suite.props.table import TABLE_HEIGHT_M

RADIUS_M, MASS_KG = 0.022, 0.05
STEM_N, STIFFNESS, DAMPING = 6.0, 240.0, 2.0  # what it holds; N/m; N s/m
SPIN_DAMPING = 1e-4  # N m s/rad, of a fruit that turns on its calyx; its fall, N s/m, it does not slow
STEM_M, ROOT_M = 0.040, 0.045  # its length unstretched; from its root to the middle of a fruit that sits
SNAP_M = STEM_M + STEM_N / STIFFNESS  # its length when it breaks
CALYX_RADIUS_M, CALYX_HALF_M = 0.014, 0.003  # what is seen of it, about the stalk's end
STALK_M, STALK_RADIUS_M = 0.10, 0.010  # the stretched stem keeps the fruit in the middle of its end
FRUIT_M = STALK_M + RADIUS_M  # of its middle over the table
LEAF_HALF_M = [0.0008, 0.026, 0.032]
LEAF_ASIDE_M, LEAF_LEAN_RAD = 0.038, np.deg2rad(15.0)  # of its hinge; towards the fruit
LEAF_KG, LEAF_STIFFNESS, LEAF_DAMPING, LEAF_ARMATURE = 0.003, 0.03, 0.001, 2e-5
# Soft and full of juice: it does not bounce, and rolling friction stops it.
FRUIT = {"friction": [1.2, 0.02, 0.003], "solref": [0.01, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0], "condim": 6}
CALYX = {"friction": [0.8, 0.005, 0.0001], "condim": 3, "priority": 1}
RED, UNRIPE = [0.85, 0.12, 0.10, 1.0], [0.45, 0.72, 0.20, 1.0]
LEAF, STALK = [0.13, 0.42, 0.16, 1.0], [0.35, 0.45, 0.20, 1.0]


def add_plant(spec: mujoco.MjSpec, fruit: str, *, ripe: bool) -> None:
    """A mocap body ``plant_FRUIT``, origin on the table, with a free fruit: red if ``ripe``, else green.

    The actuator ``stem_FRUIT`` is its stem, and the sensor of that name gives how long that is, m. The leaf is on
    the plant's x axis.
    """
    plant = spec.worldbody.add_body(name=f"plant_{fruit}", mocap=True)
    _add_stalk(plant, fruit)
    _add_leaf(plant, f"leaf_{fruit}")
    body = spec.worldbody.add_body(name=fruit)
    body.add_joint(name=fruit, type=mujoco.mjtJoint.mjJNT_FREE, damping=SPIN_DAMPING)
    look = {"size": [RADIUS_M, 0, 0], "rgba": RED if ripe else UNRIPE}
    body.add_geom(name=fruit, type=mujoco.mjtGeom.mjGEOM_SPHERE, mass=MASS_KG, **look, **WORLD, **FRUIT)
    body.add_site(name=fruit, size=[0.003] * 3, group=4)
    _add_stem(spec, f"stem_{fruit}", (f"root_{fruit}", fruit))


def grow(view: View, world: int, fruit: str, pos: np.ndarray, yaw: float) -> None:
    """Put a plant of one world at ``pos`` (2,) m of the table with its fruit, whole, its leaf at ``yaw`` rad."""
    place(view, world, f"plant_{fruit}", np.array([*pos, TABLE_HEIGHT_M]), yaw=yaw)
    pose, _ = view.free_joint(fruit)
    view.qpos[world, pose] = [*pos, TABLE_HEIGHT_M + FRUIT_M, 1.0, 0.0, 0.0, 0.0]
    view.worlds.bind("ctrl")[world, view.model.actuator(f"stem_{fruit}").id] = 1.0


def _add_stalk(plant: mujoco.MjsBody, fruit: str) -> None:
    """A post, the calyx about its end, and the point in it where the stem is rooted."""
    cylinder, height = mujoco.mjtGeom.mjGEOM_CYLINDER, 0.5 * STALK_M
    post = {"pos": [0, 0, height], "size": [STALK_RADIUS_M, height, 0], "rgba": STALK}
    plant.add_geom(name=f"stalk_{fruit}", type=cylinder, **post, **FIXTURE, **HARD, **CALYX)
    disc = {"pos": [0, 0, STALK_M - CALYX_HALF_M], "size": [CALYX_RADIUS_M, CALYX_HALF_M, 0], "rgba": LEAF}
    plant.add_geom(name=f"calyx_{fruit}", type=cylinder, **disc, **NOTHING)
    plant.add_site(name=f"plant_{fruit}", size=[0.003] * 3, group=4)
    plant.add_site(name=f"root_{fruit}", pos=[0, 0, FRUIT_M - ROOT_M], size=[0.003] * 3, group=4)


def _add_leaf(plant: mujoco.MjsBody, name: str) -> None:
    """A flap on a horizontal hinge with a spring, which leans towards the fruit and gives way to a finger."""
    half = -0.5 * LEAF_LEAN_RAD
    upright = {"pos": [LEAF_ASIDE_M, 0, STALK_M - 0.015], "quat": [np.cos(half), 0, np.sin(half), 0]}
    leaf = plant.add_body(name=name, **upright)
    leaf.add_joint(
        name=name, axis=[0, 1, 0], range=[-0.6, 1.4], limited=True, stiffness=LEAF_STIFFNESS, damping=LEAF_DAMPING,
        armature=LEAF_ARMATURE,
    )  # fmt: skip
    blade = {"pos": [0, 0, LEAF_HALF_M[2]], "size": LEAF_HALF_M, "rgba": LEAF, "mass": LEAF_KG}
    leaf.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, **blade, **FIXTURE)
    twig = {"fromto": [0, 0, 0, -LEAF_ASIDE_M, 0, -0.03], "size": [0.0015, 0, 0], "rgba": STALK, "mass": 0}
    leaf.add_geom(name=f"{name}_twig", type=mujoco.mjtGeom.mjGEOM_CAPSULE, **twig, **NOTHING)


def _add_stem(spec: mujoco.MjSpec, name: str, ends: tuple[str, str]) -> None:
    """A tendon that nobody sees, a spring along it, and a sensor of its length."""
    tendon = spec.add_tendon(name=name, rgba=[0, 0, 0, 0])
    for end in ends:
        tendon.wrap_site(end)
    spring = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
    spring.gaintype = mujoco.mjtGain.mjGAIN_AFFINE
    spring.gainprm[:3] = [STIFFNESS * STEM_M, -STIFFNESS, -DAMPING]
    spring.forcelimited, spring.forcerange = True, [-STEM_N, STEM_N]  # until the control step is over in which it broke
    sensor = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_TENDONPOS)
    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_TENDON, name

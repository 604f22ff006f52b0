"""A lamp that stands loosely in a threaded socket, to be screwed in."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import FIXTURE, NOTHING, WORLD
from aerial_il.suite.props.contact import GRASPABLE, HARD, STICTION
from aerial_il.suite.props.post import GREY, add_post

LEAD_M = 0.0036  # of the thread: what a turn lowers the lamp by; that of the Edison screw E27 (IEC 60061) to 0.03 mm
TURNS = 2.0  # from where the thread begins to where the lamp is screwed in
STOP_RAD = 2.0 * np.pi * TURNS + 0.6
FRICTION_NM, DAMPING = 0.02, 0.01  # of the thread: N m, N m s/rad
# The sprung contact in the middle of the socket, which the lamp meets a turn before the end: it makes the last turn
# heavier, by about 0.07 N m at the end. Its armature keeps so stiff a spring stable in steps of 4 ms.
CONTACT_N, CONTACT_STIFFNESS, CONTACT_DAMPING, CONTACT_ARMATURE = 3.0, 1500.0, 20.0, 0.05
CONTACT_TRAVEL_M = 0.006
RUB_M = 0.008  # lever at which the friction between the two acts
FLATS_HALF_M, FLATS_HALF_HEIGHT_M = 0.016, 0.015
DOME_M = (0.014, 0.014, 0.012)
MASS_KG = 0.06
SOCKET_RADIUS_M, SOCKET_DEPTH_M = 0.03, 0.03  # of its outside; of its walls
SOCKET_TOP_M = -TURNS * LEAD_M - 0.006  # its upper edge, which fingers that hold the lamp do not meet
WALL_HALF_M = 0.005
NECK_RADIUS_M, NECK_M = 0.013, 0.022  # the part with the thread, below the flats
WHITE, BRASS, GLOW = [0.93, 0.93, 0.90, 1.0], [0.80, 0.66, 0.30, 1.0], [1.0, 0.85, 0.35, 0.9]


def add_bulb(spec: mujoco.MjSpec) -> None:
    """Add mocap bodies ``socket``, origin under the flats of a lamp that stands in it loosely, and ``socket_stand``.

    The joints ``bulb_turn`` (rad) and ``bulb_travel`` (m, downwards) count how far the lamp ``bulb`` is screwed in; the
    thread couples them. The site ``bulb`` is the middle of its flats, which make a square.
    """
    add_post(spec, "socket_stand", 0.025)
    socket = spec.worldbody.add_body(name="socket", mocap=True)
    _add_socket(socket)
    contact = socket.add_body(name="socket_contact", pos=[0, 0, -NECK_M - 0.5 * TURNS * LEAD_M])
    contact.add_joint(
        name="socket_contact", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, -1], range=[0, CONTACT_TRAVEL_M],
        limited=True, stiffness=CONTACT_STIFFNESS, springref=-CONTACT_N / CONTACT_STIFFNESS, damping=CONTACT_DAMPING,
        armature=CONTACT_ARMATURE, solref_limit=[0.01, 1.0],
    )  # fmt: skip
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    disc = {"pos": [0, 0, -0.002], "size": [0.008, 0.002, 0], "mass": 0.005, "rgba": BRASS}
    contact.add_geom(name="socket_contact", type=cylinder, **disc, **WORLD, **HARD)
    for name, size in (("x", [0.042, 0.004, 0.002]), ("y", [0.004, 0.042, 0.002])):  # what is seen of it
        contact.add_geom(
            name=f"socket_terminal_{name}", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, mass=0, rgba=BRASS, **NOTHING
        )
    bulb = socket.add_body(name="bulb")
    bulb.add_joint(name="bulb_travel", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, -1], armature=0.5)
    bulb.add_joint(
        name="bulb_turn", axis=[0, 0, -1], range=[0.0, STOP_RAD], limited=True, frictionloss=FRICTION_NM,
        solimp_friction=STICTION, damping=DAMPING, armature=0.0002,
    )  # fmt: skip
    _add_lamp(bulb)
    _add_thread(spec)


def _add_thread(spec: mujoco.MjSpec) -> None:
    """Couple the lamp's turn and its travel.

    By a tendon that keeps its length: MuJoCo makes an equality of two joints as soft as the lighter of them alone.
    """
    thread = spec.add_tendon(name="thread")
    thread.wrap_joint("bulb_travel", 1.0)
    thread.wrap_joint("bulb_turn", -LEAD_M / (2.0 * np.pi))
    fixed = spec.add_equality(
        name="thread", type=mujoco.mjtEq.mjEQ_TENDON, name1="thread", solref=[0.01, 1.0], solimp=STICTION
    )
    fixed.objtype = mujoco.mjtObj.mjOBJ_TENDON


def _add_socket(socket: mujoco.MjsBody) -> None:
    """Eight walls."""
    half = 0.5 * SOCKET_DEPTH_M
    for i, angle in enumerate(np.arange(8) * np.pi / 4):
        c, s = np.cos(angle), np.sin(angle)
        wall = [WALL_HALF_M, SOCKET_RADIUS_M * np.tan(np.pi / 8), half]
        turn, away = [np.cos(0.5 * angle), 0, 0, np.sin(0.5 * angle)], SOCKET_RADIUS_M - WALL_HALF_M
        look = {"pos": [away * c, away * s, SOCKET_TOP_M - half], "quat": turn, "size": wall, "rgba": WHITE}
        socket.add_geom(name=f"socket_wall_{i}", type=mujoco.mjtGeom.mjGEOM_BOX, **look, **FIXTURE)


def _add_lamp(bulb: mujoco.MjsBody) -> None:
    """Flats to grip, a dome over them, the neck with the thread below."""
    height = FLATS_HALF_HEIGHT_M
    shape = mujoco.mjtGeom
    flats = {"pos": [0, 0, height], "size": [FLATS_HALF_M, FLATS_HALF_M, height], "mass": 0.7 * MASS_KG, "rgba": GREY}
    bulb.add_geom(name="bulb_flats", type=shape.mjGEOM_BOX, **flats, **FIXTURE, **GRASPABLE)
    dome = {"pos": [0, 0, 2.0 * height], "size": DOME_M, "mass": 0.1 * MASS_KG, "rgba": GLOW}
    bulb.add_geom(name="bulb_dome", type=shape.mjGEOM_ELLIPSOID, **dome, **FIXTURE)
    neck = {"fromto": [0, 0, -NECK_M, 0, 0, 0], "size": [NECK_RADIUS_M, 0, 0], "mass": 0.2 * MASS_KG, "rgba": BRASS}
    rub = {"friction": [0.6, RUB_M, 0.0001], "condim": 4, "priority": 1}
    bulb.add_geom(name="bulb_neck", type=shape.mjGEOM_CYLINDER, **neck, **WORLD, **HARD, **rub)
    bulb.add_site(name="bulb", pos=[0, 0, height], size=[0.003] * 3, group=4)

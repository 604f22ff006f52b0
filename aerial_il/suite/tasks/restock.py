"""Restock: open a cabinet, put three cubes in from the table, close it."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, free_vel, joint_pos, site_pos, tip_pos, tool_pos, touching, untouched
from aerial_il.suite.props import CUBE_HALF_M, FALLEN_M, TABLE_HEIGHT_M, add_cube, add_table
from aerial_il.suite.props.cabinet import FLOOR_M, WALL_M, add_cabinet
from aerial_il.suite.props.door import DEPTH_M, WIDTH_M
from aerial_il.suite.props.place import places_apart
from aerial_il.suite.tasks.cabinet_retrieve import (
    AT_REST_M_S,
    DOOR,
    LOOP,
    OPEN_ENOUGH_RAD,
    door_fields,
    in_cabinet,
    infeasible_cabinet,
    observe_door,
    place_cabinet,
)
from aerial_il.suite.tasks.fields import direction, seen
from aerial_il.suite.tasks.open_door import hooked
from aerial_il.suite.tasks.pick_place import heading_of
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

CLOSED_RAD = np.deg2rad(5.0)
COLOURS = {"orange": (0.95, 0.45, 0.12, 1.0), "yellow": (0.95, 0.78, 0.15, 1.0), "purple": (0.45, 0.25, 0.60, 1.0)}
AREA_LOW, AREA_HIGH = np.array([-0.32, 0.10]), np.array([-0.04, 0.42])  # where no door sweeps, in sight of the camera
APART_M = 0.13
START_LOW, START_HIGH = np.array([-0.35, -0.25, 1.2]), np.array([0.0, 0.25, 1.35])
CUBES, FIRST_CUBE = 3, 2  # sites
FIRST_FREE = 1  # joints
TOUCHING = 6  # contacts: both pads on each cube, then the robot on anything


class Restock(Task):
    """All three cubes in the cabinet and slower than 2 cm/s, its door closed to within 5°, robot on nothing, for 1 s.

    In the cabinet: a cube's middle is between its walls, over its floor, and at least half a cube below their upper
    edge; it may lie on another. The cabinet is that of `cabinet_retrieve`: the door, front and top in one piece, has to
    be opened by some 75°, and closed again past what its dry friction holds. A cube more than 10 cm below the table's
    surface that is not in the gripper is lost: the episode ends as dropped.
    """

    name = "restock"
    grade = "hard"
    instruction = "Open the cabinet, put the three cubes from the table into it and close it again."
    wordings = (
        "Put all three cubes into the cabinet and shut it.",
        "Open the cabinet, fill it with the cubes and close its door.",
        "打开柜门，把三个方块放进柜子，再关上门。",
        "把桌上的三个方块都放进柜里并关门。",
    )
    held_out = (
        "Open the cabinet, put the cubes in, then close the door.",
        "请把三个方块放入柜子，关好门。",
    )
    time_limit_s = 90.0
    dwell_s = 1.0
    subtasks = ("hooked", "open", "one_in", "two_in", "all_in", "closed")
    names = Names(
        sites=("loop", "door", *(f"cube_{name}" for name in COLOURS)),
        joints=("door", *(f"cube_{name}" for name in COLOURS)),
        contacts=(*(f"grip_{side}_{name}" for name in COLOURS for side in ("left", "right")), "robot_on_anything"),
    )
    sight = (4, 30)
    scene_height_m = 0.8

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_cabinet(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_cabinet(spec)
        for name, rgba in COLOURS.items():
            add_cube(spec, f"cube_{name}", rgba)
            for side in ("left", "right"):
                add_contact_sensor(spec, f"grip_{side}_{name}", geoms=(f"pad_{side}", f"cube_{name}"))
        add_touch_sensor(spec, "robot_on_anything")

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        place_cabinet(view, world, rng)
        places = places_apart(rng, AREA_LOW, AREA_HIGH, CUBES, apart=APART_M)
        for name, pos in zip(COLOURS, places, strict=True):
            yaw = rng.uniform(-np.pi, np.pi)
            pose, _ = view.free_joint(f"cube_{name}")
            lying = TABLE_HEIGHT_M + CUBE_HALF_M
            view.qpos[world, pose] = [*pos, lying, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]

    def fields(self) -> tuple[Field, ...]:
        return (*door_fields(), *(field for name in COLOURS for field in _fields_of(name)))


@kernel
def observe(world, found):
    observe_door(world, found)
    for k in range(CUBES):
        cube = site_pos(world, FIRST_CUBE + k)
        forth, aside, up = in_cabinet(world, cube)
        put(found, 15 + 11 * k, cube)
        found[18 + 11 * k], found[19 + 11 * k] = heading_of(world, FIRST_CUBE + k)
        put(found, 20 + 11 * k, sub(cube, tool_pos(world)))
        put(found, 23 + 11 * k, (forth, aside, up))


@kernel
def solved(world):
    still = True
    for k in range(CUBES):
        still = still and norm(free_vel(world, FIRST_FREE + k)) <= AT_REST_M_S
    free = not touching(world, TOUCHING)
    return number_in(world) == CUBES and still and closed(world) and free and untouched(world)


@kernel
def lost(world):
    fallen = False
    for k in range(CUBES):
        low = site_pos(world, FIRST_CUBE + k)[2] < TABLE_HEIGHT_M - FALLEN_M
        fallen = fallen or (low and not grasped(world, k))
    return fallen


@kernel
def progress(world, flags):
    count = number_in(world)
    flags[0], flags[1] = hooked(world), joint_pos(world, DOOR) >= OPEN_ENOUGH_RAD
    flags[2], flags[3], flags[4] = count >= 1, count >= 2, count >= 3
    flags[5] = count == CUBES and closed(world)


@kernel
def reward(world):
    """An eighth for opening, a quarter for each cube, an eighth for closing."""
    count, share = number_in(world), clip(joint_pos(world, DOOR) / OPEN_ENOUGH_RAD, 0.0, 1.0)
    near = closeness(norm(sub(site_pos(world, LOOP), tip_pos(world))), 0.15)
    if count == CUBES:
        return 0.875 + 0.025 * near + 0.1 * (1.0 - share)
    if share < 1.0:
        return 0.25 * count + 0.025 * near + 0.1 * share
    nearest = 0.0
    for k in range(CUBES):
        if not inside(world, k):
            nearest = max(nearest, on_its_way(world, k))
    return 0.125 + 0.25 * (count + nearest)


@kernel
def on_its_way(world, k):
    """Share of the way into the cabinet, from 0 to 1, that cube ``k`` has come: approached, held, carried."""
    cube = site_pos(world, FIRST_CUBE + k)
    if not grasped(world, k):
        return 0.3 * closeness(norm(sub(cube, tool_pos(world))), 0.2)
    forth, aside, _ = in_cabinet(world, cube)
    return 0.5 + 0.4 * closeness(planar_norm((forth + 0.5 * DEPTH_M, aside, 0.0)), 0.2)


@kernel
def grasped(world, k):
    """Whether both pads touch cube ``k``."""
    return touching(world, 2 * k) and touching(world, 2 * k + 1)


@kernel
def inside(world, k):
    """Whether cube ``k`` is in the cabinet."""
    forth, aside, up = in_cabinet(world, site_pos(world, FIRST_CUBE + k))
    between = -DEPTH_M <= forth <= 0.0 and abs(aside) <= 0.5 * WIDTH_M
    return between and FLOOR_M <= up <= WALL_M - CUBE_HALF_M


@kernel
def number_in(world):
    """How many cubes are in the cabinet."""
    count = 0
    for k in range(CUBES):
        if inside(world, k):
            count += 1
    return count


@kernel
def closed(world):
    """Whether the door is."""
    return abs(joint_pos(world, DOOR)) <= CLOSED_RAD


def _fields_of(name: str) -> tuple[Field, ...]:
    cube, labels = f"{name}_cube", ("out", "left", "up")
    return (
        seen(f"{cube}_pos", f"centre of the {name} cube"),
        direction(f"{cube}_heading", "of four times its yaw, the same for all four faces", labels=("cos4", "sin4")),
        seen(f"tool_to_{cube}", "from the tool to it"),
        seen(f"{cube}_in_cabinet", "its place from the foot of the cabinet's front", frame="cabinet", labels=labels),
    )


TASK = Restock(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, lost=lost))

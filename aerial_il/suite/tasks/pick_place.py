"""Pick and place: take a cube off the table and let go of it inside the bowl."""

from __future__ import annotations

import math
from functools import partial

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, base_pos, free_vel, site_mat, site_pos, tool_pos, touching, untouched
from aerial_il.suite.props import CUBE_HALF_M, FALLEN_M, TABLE_HEIGHT_M, add_bowl, add_cube, add_table
from aerial_il.suite.props.place import two_places
from aerial_il.suite.tasks.fields import direction, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start, pointing_down

IN_BOWL_M = 0.05  # horizontal distance between cube and bowl
LOW_IN_BOWL_M, HIGH_IN_BOWL_M = 0.02, 0.05  # over the bowl's underside; 0.028 lying in it, 0.055 lying on its rim
AT_REST_M_S = 0.05
CLEAR_OF_CUBE_M = 0.10
LIFTED_M = 0.06
AREA_LOW, AREA_HIGH = np.array([-0.25, -0.35]), np.array([0.25, 0.35])
APART_M = 0.22
HEADROOM_M = 0.27  # above the table, that carrying and backing off take
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.1]), np.array([0.3, 0.3, 1.4])
CUBE, BOWL = range(2)  # sites; the cube is the first joint too
GRIP_LEFT, GRIP_RIGHT, ROBOT_ON_CUBE = range(3)  # contacts


class PickPlace(Task):
    """Cube released in the bowl within 5 cm, slower than 5 cm/s, gripper at least 10 cm away, for 0.5 s.

    In the bowl: the cube's centre is at most 5 cm from the bowl's axis and 2 to 5 cm above its underside, so neither
    on the rim nor under the table. Released: no part of the robot touches it.

    A cube more than 10 cm below the table's surface, on the floor or on its way there, that is not in the gripper is
    lost: the episode ends as dropped. So is one that lies still out of reach of an arm on a fixed base.
    """

    name = "pick_place"
    grade = "medium"
    instruction = "Pick up the orange cube and place it in the blue bowl."
    wordings = (
        "Put the orange cube into the blue bowl.",
        "Grasp the orange cube and drop it in the bowl.",
        "把橙色方块放进蓝色的碗里。",
        "拿起橙色方块，放到碗中。",
    )
    held_out = ("Move the orange cube to the blue bowl.", "请把橙色方块放到碗里。")
    time_limit_s = 30.0
    dwell_s = 0.5
    subtasks = ("at_cube", "grasped", "lifted", "over_bowl", "in_bowl")
    names = Names(sites=("cube", "bowl"), joints=("cube",), contacts=("grip_left", "grip_right", "robot_on_cube"))

    needs_flight = False

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening = 2.0 * robot.gripper.stroke
        if opening < 2.4 * CUBE_HALF_M:
            return f"its gripper opens {100 * opening:.1f} cm, the cube needs {240 * CUBE_HALF_M:.1f} cm"
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_cube_and_bowl(spec)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        cube, bowl = two_places(rng, AREA_LOW, AREA_HIGH, apart=APART_M, workable=partial(workable, view.robot))
        yaw = rng.uniform(-np.pi, np.pi)
        pose, _ = view.free_joint("cube")
        view.qpos[world, pose] = [*cube, TABLE_HEIGHT_M + CUBE_HALF_M, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
        view.mocap_pos[world, view.mocap_id("bowl")] = [*bowl, TABLE_HEIGHT_M]

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("cube_pos", "centre of the cube"),
            direction("cube_heading", "of four times its yaw, the same for all four faces", labels=("cos4", "sin4")),
            seen("bowl_pos", "middle of the bowl"),
            seen("tool_to_cube", "from the tool to the cube"),
            seen("cube_to_bowl", "from the cube to the bowl"),
        )


def add_cube_and_bowl(spec: mujoco.MjSpec) -> None:
    """Add the cube, the bowl and sensors of who touches the cube."""
    add_cube(spec)
    add_bowl(spec)
    for side in ("left", "right"):
        add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "cube"))
    add_touch_sensor(spec, "robot_on_cube", "cube")


@kernel
def observe(world, found):
    cube, bowl = site_pos(world, CUBE), site_pos(world, BOWL)
    put(found, 0, cube)
    found[3], found[4] = cube_heading(world)
    put(found, 5, bowl)
    put(found, 8, sub(cube, tool_pos(world)))
    put(found, 11, sub(bowl, cube))


@kernel
def solved(world):
    clear = norm(sub(site_pos(world, CUBE), tool_pos(world))) >= CLEAR_OF_CUBE_M
    released = clear and not touching(world, ROBOT_ON_CUBE)
    return in_bowl(world) and slow(world) and released and untouched(world)


@kernel
def lost(world):
    cube = site_pos(world, CUBE)
    fallen = cube[2] < TABLE_HEIGHT_M - FALLEN_M
    too_far = slow(world) and norm(sub(cube, base_pos(world))) > world.longest_reach
    return (fallen or too_far) and not grasped(world)


@kernel
def progress(world, flags):
    cube, bowl, held = site_pos(world, CUBE), site_pos(world, BOWL), grasped(world)
    lifted = held and cube[2] >= TABLE_HEIGHT_M + CUBE_HALF_M + LIFTED_M
    flags[0] = norm(sub(cube, tool_pos(world))) <= 0.03
    flags[1], flags[2] = held, lifted
    flags[3] = lifted and planar_norm(sub(cube, bowl)) <= IN_BOWL_M
    flags[4] = in_bowl(world)


@kernel
def reward(world):
    cube, bowl = site_pos(world, CUBE), site_pos(world, BOWL)
    distance = norm(sub(cube, tool_pos(world)))
    if in_bowl(world):
        return 0.75 + 0.25 * clip(distance / CLEAR_OF_CUBE_M, 0.0, 1.0)
    if grasped(world):
        home = closeness(planar_norm(sub(cube, bowl)), 0.15)
        return 0.4 + 0.15 * home + 0.15 * clip((cube[2] - TABLE_HEIGHT_M - CUBE_HALF_M) / LIFTED_M, 0.0, 1.0)
    return 0.3 * closeness(distance, 0.2)


@kernel
def slow(world):
    """Whether the cube lies still."""
    return norm(free_vel(world, CUBE)) <= AT_REST_M_S


@kernel
def grasped(world):
    """Whether both pads touch the cube."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def cube_heading(world):
    return heading_of(world, CUBE)


@kernel
def heading_of(world, cube):
    """Cosine and sine of four times the yaw of a cube's site: the same for every face that could be gripped."""
    mat = site_mat(world, cube)
    length = math.sqrt(mat[0] * mat[0] + mat[3] * mat[3]) + 1e-9
    c, s = mat[0] / length, mat[3] / length
    c2, s2 = c * c - s * s, 2.0 * c * s
    return c2 * c2 - s2 * s2, 2.0 * c2 * s2


@kernel
def cube_yaw(world):
    """The cube's yaw, rad, that is nearest to zero among those of its four faces."""
    c, s = cube_heading(world)
    return 0.25 * math.atan2(s, c)


@kernel
def in_bowl(world):
    """Whether the cube lies in the bowl."""
    offset = sub(site_pos(world, CUBE), site_pos(world, BOWL))
    return planar_norm(offset) <= IN_BOWL_M and LOW_IN_BOWL_M <= offset[2] <= HIGH_IN_BOWL_M


def workable(robot: Robot, place: np.ndarray) -> bool:
    """Whether the tool can go down at a place (2,) m of the table, from as high as it travels."""
    heights = (TABLE_HEIGHT_M + 0.5 * CUBE_HALF_M, TABLE_HEIGHT_M + HEADROOM_M)
    return all(robot.reachable(np.array([*place, height]), pointing_down(0.0)) for height in heights)


TASK = PickPlace(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, lost=lost))

"""Cabinet retrieve: open a cabinet, take the cube out of it and set it down upright on a marked place."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pulling
from aerial_il.suite.physics.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    free_vel,
    joint_pos,
    joint_vel,
    site_mat,
    site_pos,
    tip_pos,
    tool_pos,
    touching,
    untouched,
)
from aerial_il.suite.props import CUBE_HALF_M, FALLEN_M, TABLE_HEIGHT_M, add_cube, add_table
from aerial_il.suite.props.cabinet import FLOOR_M, WALL_M, add_cabinet
from aerial_il.suite.props.door import DEPTH_M, DOOR_DAMPING, DOOR_FRICTION_NM, HINGE_TO_LOOP_M, LEAF_M, WIDTH_M
from aerial_il.suite.props.place import place
from aerial_il.suite.props.spot import add_spot
from aerial_il.suite.tasks.fields import direction, seen
from aerial_il.suite.tasks.open_door import SWING_RAD_S, hooked
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

ON_SPOT_M = 0.015  # between the middles of cube and place, level
LEVEL_M = 0.004  # of the cube's middle from where it is when it lies on the table
UPRIGHT_COS = np.cos(np.deg2rad(10.0))
AT_REST_M_S = 0.02
CLEAR_OF_CUBE_M = 0.10
OPEN_ENOUGH_RAD = np.deg2rad(75.0)  # from where on the door's top is out of the way
CABINET_LOW, CABINET_HIGH = np.array([0.15, -0.26]), np.array([0.23, -0.18])
CABINET_YAW_RAD = np.deg2rad([150.0, 210.0])
SPOT_LOW, SPOT_HIGH = np.array([-0.30, 0.14]), np.array([-0.06, 0.38])
CUBE_LOW, CUBE_HIGH = np.array([-0.095, -0.08]), np.array([-0.055, 0.08])  # in the cabinet's frame
CUBE_YAW_RAD = np.deg2rad(45.0)  # either way, to the cabinet
START_ANGLE_RAD = (0.0, np.deg2rad(6.0))
START_LOW, START_HIGH = np.array([-0.35, -0.25, 1.2]), np.array([0.0, 0.25, 1.35])
HINGE_ASIDE_M = 0.5 * LEAF_M  # from the middle of the cabinet to its hinge
LOOP, HINGE, CUBE, SPOT = range(4)  # sites
DOOR, FREE_CUBE = range(2)  # joints
GRIP_LEFT, GRIP_RIGHT, ROBOT_ON_CUBE = range(3)  # contacts


class CabinetRetrieve(Task):
    """Cube upright and at rest within 1.5 cm of the marked place, on the table, let go, for 1 s.

    Upright: the face that was up in the cabinet is up, within 10°; on the table: its middle is within 4 mm of where it
    lies there. At rest: slower than 2 cm/s. Let go: no part of the robot touches it, and the tool is at least 10 cm
    away. The door may stay open.

    The cabinet's door is its front and its top in one piece, on a vertical hinge with dry friction: it has to be opened
    by some 75° before a gripper can go down to the cube. Between the walls, 13 cm high, cube and gripper have a few
    centimetres on each side. A cube more than 10 cm below the table's surface that is not in the gripper is lost: the
    episode ends as dropped.
    """

    name = "cabinet_retrieve"
    grade = "hard"
    instruction = "Open the cabinet, take the orange cube out of it and set it down upright on the white spot."
    wordings = (
        "Open the door, take the cube out of the cabinet and place it on the spot.",
        "Fetch the orange cube from the cabinet and stand it on the white spot.",
        "打开柜子，取出橙色方块，放到白色标记上。",
        "从柜子里拿出方块，立在白点上。",
    )
    held_out = (
        "Take the cube out of the cabinet and set it on the white spot.",
        "请从柜中取出方块放到白色标记。",
    )
    time_limit_s = 60.0
    dwell_s = 1.0
    subtasks = ("hooked", "open", "grasped", "out", "over_spot", "set_down")
    names = Names(
        sites=("loop", "door", "cube", "spot"),
        joints=("door", "cube"),
        contacts=("grip_left", "grip_right", "robot_on_cube"),
    )
    sight = (3, 16)
    scene_height_m = 0.8

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_cabinet(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_cabinet(spec)
        add_spot(spec, radius=ON_SPOT_M)
        add_cube(spec)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "cube"))
        add_touch_sensor(spec, "robot_on_cube", "cube")

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        cabinet, yaw = place_cabinet(view, world, rng)
        place(view, world, "spot", np.array([*rng.uniform(SPOT_LOW, SPOT_HIGH), TABLE_HEIGHT_M]))
        inside, turn = rng.uniform(CUBE_LOW, CUBE_HIGH), yaw + rng.uniform(-CUBE_YAW_RAD, CUBE_YAW_RAD)
        c, s = np.cos(yaw), np.sin(yaw)
        pos = cabinet[:2] + inside @ np.array([[c, s], [-s, c]])
        lying = TABLE_HEIGHT_M + FLOOR_M + CUBE_HALF_M
        pose, _ = view.free_joint("cube")
        view.qpos[world, pose] = [*pos, lying, np.cos(0.5 * turn), 0.0, 0.0, np.sin(0.5 * turn)]

    def fields(self) -> tuple[Field, ...]:
        return (
            *door_fields(),
            seen("cube_pos", "centre of the cube"),
            direction("cube_heading", "of its x axis"),
            seen("tool_to_cube", "from the tool to the cube"),
            seen("spot_pos", "middle of the marked place"),
            seen("cube_to_spot", "from the cube to the marked place"),
        )


def infeasible_cabinet(robot: Robot) -> str | None:
    """Say why ``robot`` cannot open the cabinet or grasp a cube in it, or None if it can."""
    opening = 2.0 * robot.gripper.stroke
    if opening < 2.4 * CUBE_HALF_M:
        return f"its gripper opens {100 * opening:.1f} cm, the cube needs {240 * CUBE_HALF_M:.1f} cm"
    torque = DOOR_FRICTION_NM + DOOR_DAMPING * SWING_RAD_S
    return infeasible_pulling(robot, torque / HINGE_TO_LOOP_M)


def place_cabinet(view: View, world: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Put the cabinet of one world on the table, its door ajar; return where (3,) m, and its yaw, rad."""
    pos, yaw = np.array([*rng.uniform(CABINET_LOW, CABINET_HIGH), TABLE_HEIGHT_M]), rng.uniform(*CABINET_YAW_RAD)
    place(view, world, "cabinet", pos, yaw=yaw)
    angle, _ = view.joint("door")
    angle[world] = rng.uniform(*START_ANGLE_RAD)
    return pos, yaw


def door_fields() -> tuple[Field, ...]:
    """Fields of a cabinet's door: the first 15 numbers of what a task with one shows."""
    return (
        seen("hinge_pos", "the door's hinge"),
        seen("door_angle", "opening of the door; 0 closed", 1, unit="rad", frame="about the hinge"),
        seen("door_rate", "its rate", 1, unit="rad/s", frame="about the hinge"),
        direction("door_direction", "x axis of the leaf, at the handle"),
        direction("cabinet_direction", "x axis of the cabinet, out of its front"),
        seen("loop_pos", "middle of the handle's loop"),
        seen("tip_to_loop", "from the fingertips to the loop"),
    )


@kernel
def observe_door(world, found):
    loop, mat, frame = site_pos(world, LOOP), site_mat(world, LOOP), site_mat(world, HINGE)
    put(found, 0, site_pos(world, HINGE))
    found[3], found[4] = joint_pos(world, DOOR), joint_vel(world, DOOR)
    found[5], found[6] = mat[0], mat[3]
    found[7], found[8] = frame[0], frame[3]
    put(found, 9, loop)
    put(found, 12, sub(loop, tip_pos(world)))


@kernel
def observe(world, found):
    cube, spot, mat = site_pos(world, CUBE), site_pos(world, SPOT), site_mat(world, CUBE)
    observe_door(world, found)
    put(found, 15, cube)
    length = max(norm((mat[0], mat[3], 0.0)), 1e-9)
    found[18], found[19] = mat[0] / length, mat[3] / length
    put(found, 20, sub(cube, tool_pos(world)))
    put(found, 23, spot)
    put(found, 26, sub(spot, cube))


@kernel
def solved(world):
    clear = norm(sub(site_pos(world, CUBE), tool_pos(world))) >= CLEAR_OF_CUBE_M
    released = clear and not touching(world, ROBOT_ON_CUBE)
    return set_down(world) and norm(free_vel(world, FREE_CUBE)) <= AT_REST_M_S and released and untouched(world)


@kernel
def lost(world):
    return site_pos(world, CUBE)[2] < TABLE_HEIGHT_M - FALLEN_M and not grasped(world)


@kernel
def progress(world, flags):
    held = grasped(world)
    flags[0] = hooked(world)
    flags[1] = joint_pos(world, DOOR) >= OPEN_ENOUGH_RAD
    flags[2], flags[3] = held, held and not cube_within(world)
    flags[4] = held and planar_norm(sub(site_pos(world, CUBE), site_pos(world, SPOT))) <= ON_SPOT_M
    flags[5] = set_down(world)


@kernel
def reward(world):
    cube, spot = site_pos(world, CUBE), site_pos(world, SPOT)
    distance = norm(sub(cube, tool_pos(world)))
    if set_down(world):
        return 0.85 + 0.15 * clip(distance / CLEAR_OF_CUBE_M, 0.0, 1.0)
    if not cube_within(world):
        near = closeness(planar_norm(sub(cube, spot)), 0.15)
        return 0.5 + (0.1 if grasped(world) else 0.0) + 0.2 * near
    if joint_pos(world, DOOR) >= OPEN_ENOUGH_RAD:
        return 0.3 + 0.1 * closeness(distance, 0.2) + (0.1 if grasped(world) else 0.0)
    near = closeness(norm(sub(site_pos(world, LOOP), tip_pos(world))), 0.15)
    return 0.1 * near + 0.2 * clip(joint_pos(world, DOOR) / OPEN_ENOUGH_RAD, 0.0, 1.0)


@kernel
def grasped(world):
    """Whether both pads touch the cube."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def cube_within(world):
    """Whether the cube's middle is between the walls of the cabinet."""
    forth, aside, up = in_cabinet(world, site_pos(world, CUBE))
    return -DEPTH_M <= forth <= 0.0 and abs(aside) <= 0.5 * WIDTH_M and up <= WALL_M


@kernel
def in_cabinet(world, point):
    """A point in the cabinet's frame: out of its front from there, from its middle to its left, over the table, m."""
    mat, hinge = site_mat(world, HINGE), site_pos(world, HINGE)
    offset = sub(point, hinge)
    forth, aside = offset[0] * mat[0] + offset[1] * mat[3], offset[0] * mat[1] + offset[1] * mat[4]
    return forth, aside + HINGE_ASIDE_M, point[2] - TABLE_HEIGHT_M


@kernel
def set_down(world):
    """Whether the cube lies upright on the marked place."""
    cube, mat = site_pos(world, CUBE), site_mat(world, CUBE)
    lying = abs(cube[2] - TABLE_HEIGHT_M - CUBE_HALF_M) <= LEVEL_M and mat[8] >= UPRIGHT_COS
    return lying and planar_norm(sub(cube, site_pos(world, SPOT))) <= ON_SPOT_M


TASK = CabinetRetrieve(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, lost=lost))

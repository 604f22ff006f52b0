"""Insert a peg: take it out of its stand and push it into a bore that is 2 mm wider."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, clip, closeness, column, norm, planar_norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_upright_hold
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, add_contact_sensor, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, force, site_mat, site_pos, tool_pos, touching, untouched
from aerial_il.suite.props import FALLEN_M, TABLE_HEIGHT_M, add_table
from aerial_il.suite.props.peg import FLOOR_M, PEG_LENGTH_M, PEG_RADIUS_M, add_peg, add_socket
from aerial_il.suite.props.place import place, two_places
from aerial_il.suite.tasks.fields import seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

INSERTED_M = 0.030  # of the peg's full width below the chamfer; its round nose reaches a radius deeper
CLEARANCE_M = 0.002  # bore less peg, in diameter
BORE_M, STAND_DEPTH_M = 0.056, 0.036
STAND_CLEARANCE_M = 0.006
LIFTED_M = 0.02  # of the lower end above the stand
OVER_HOLE_M = 0.01
OFF_AXIS_M = 0.004  # between the axes of bore and peg: 1 mm of play, 1.9 into the corners, and what yields
DEEPEST_M = BORE_M - PEG_RADIUS_M + 0.002  # its nose on the bottom, which yields too
GRASP_M = 0.025  # from the tool to the end of the peg that sticks out of the gripper's back
AREA_LOW, AREA_HIGH = np.array([-0.22, -0.30]), np.array([0.22, 0.30])
APART_M = 0.22
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.1]), np.array([0.3, 0.3, 1.3])
ROOM_FOR_ERRORS_M = 0.03  # between peg and open fingers, together
PEG, HOLE, STAND = range(3)  # sites
GRIP_LEFT, GRIP_RIGHT = range(2)  # contacts


class InsertPeg(Task):
    """Round-nosed peg, 20 mm thick, in a chamfered octagonal bore, 22 mm across flats (1 mm clearance all round).

    Solved when 30 mm of its full width are in the bore, below the 5 mm chamfer, for 0.5 s, held or not: where it enters
    the bore and at its lower nose its axis is within 4 mm of the bore's, and its nose is not below the bottom. It
    starts loosely in a stand; if it falls onto the table it may be picked up there. Either end may go first.

    A peg whose middle is more than 10 cm below the table's surface, on the floor or on its way there, and that is not
    in the gripper is lost: the episode ends as dropped.
    """

    name = "insert_peg"
    grade = "hard"
    instruction = "Take the orange peg out of its stand and insert it into the blue socket."
    wordings = (
        "Pull the orange peg from its stand and push it into the blue hole.",
        "Insert the peg in the blue socket.",
        "把橙色插销从支架上取下，插入蓝色的孔。",
        "将插销插进蓝色插座。",
    )
    held_out = ("Put the orange peg into the blue socket.", "请把插销插入蓝色插座里。")
    time_limit_s = 40.0
    dwell_s = 0.5
    subtasks = ("at_peg", "grasped", "lifted", "over_hole", "in_hole", "inserted")
    names = Names(sites=("peg", "hole", "stand"), contacts=("grip_left", "grip_right"))
    force_sensors = ("wrist_force",)
    privileged = (
        ("peg_axis", "the fingers occlude a peg that they hold; no camera sees how it is tilted between them"),
        ("end_to_hole", "follows from `peg_axis`"),
        ("wrist_force", CONTACT_ALONE),
    )

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.0 * PEG_RADIUS_M + ROOM_FOR_ERRORS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the peg needs {100 * needed:.1f} cm"
        return infeasible_upright_hold(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_peg(spec)
        grey, blue = [0.62, 0.62, 0.64, 1.0], [0.22, 0.42, 0.72, 1.0]
        add_socket(spec, "stand", radius=PEG_RADIUS_M + 0.5 * STAND_CLEARANCE_M, depth=STAND_DEPTH_M, rgba=grey)
        add_socket(spec, "hole", radius=PEG_RADIUS_M + 0.5 * CLEARANCE_M, depth=BORE_M, rgba=blue)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "peg"))
        add_force_sensor(spec, "wrist_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        stand, hole = two_places(rng, AREA_LOW, AREA_HIGH, apart=APART_M)
        place(view, world, "stand", np.array([*stand, TABLE_HEIGHT_M]), yaw=rng.uniform(-np.pi, np.pi))
        place(view, world, "hole", np.array([*hole, TABLE_HEIGHT_M]), yaw=rng.uniform(-np.pi, np.pi))
        pose, _ = view.free_joint("peg")
        view.qpos[world, pose] = [*stand, TABLE_HEIGHT_M + FLOOR_M + 0.5 * PEG_LENGTH_M, 1.0, 0.0, 0.0, 0.0]

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("peg_pos", "middle of the peg"),
            seen("peg_axis", "unit vector from the peg's lower end to its upper one", unit="", real=False),
            seen("hole_pos", "mouth of the hole in which the peg goes"),
            seen("stand_pos", "mouth of the hole in which the peg stands at the start"),
            seen("tool_to_peg", "from the tool to the middle of the peg"),
            seen("end_to_hole", "from the peg's lower end to the hole", real=False),
            wrist_force(),
        )


@kernel
def observe(world, found):
    peg, hole = site_pos(world, PEG), site_pos(world, HOLE)
    put(found, 0, peg)
    put(found, 3, peg_axis(world))
    put(found, 6, hole)
    put(found, 9, site_pos(world, STAND))
    put(found, 12, sub(peg, tool_pos(world)))
    put(found, 15, sub(hole, lower_end(world)))
    put(found, 18, force(world, 0))


@kernel
def solved(world):
    return depth(world) >= INSERTED_M and untouched(world)


@kernel
def lost(world):
    return site_pos(world, PEG)[2] < TABLE_HEIGHT_M - FALLEN_M and not grasped(world)


@kernel
def progress(world, flags):
    held, end, hole = grasped(world), lower_end(world), site_pos(world, HOLE)
    near_hole = planar_norm(sub(end, hole)) <= OVER_HOLE_M and end[2] >= hole[2] - PEG_RADIUS_M
    flags[0] = norm(sub(upper_end_of(world, PEG), tool_pos(world))) <= 2.0 * GRASP_M
    flags[1] = held
    flags[2] = held and end[2] >= site_pos(world, STAND)[2] + LIFTED_M
    flags[3] = held and near_hole
    flags[4], flags[5] = depth(world) > 0.0, depth(world) >= INSERTED_M


@kernel
def reward(world):
    return reward_for(world, PEG, HOLE, grasped(world))


@kernel
def reward_for(world, peg, hole_site, held):
    """Reward for how far the peg of one site has come on its way into the hole of another; ``held``: by the gripper."""
    end, hole, inside = lower_end_of(world, peg), site_pos(world, hole_site), depth_in(world, peg, hole_site)
    if inside > 0.0:
        return 0.6 + 0.4 * clip(inside / INSERTED_M, 0.0, 1.0)
    if held:
        lifted = clip((end[2] - TABLE_HEIGHT_M) / (FLOOR_M + STAND_DEPTH_M + LIFTED_M), 0.0, 1.0)
        beside = planar_norm(sub(end, hole))
        return 0.3 + 0.1 * lifted + 0.1 * closeness(beside, 0.15) + 0.1 * closeness(beside, 0.01)
    return 0.3 * closeness(norm(sub(upper_end_of(world, peg), tool_pos(world))), 0.2)


@kernel
def grasped(world):
    """Whether both pads touch the peg."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def peg_axis(world):
    return axis_of(world, PEG)


@kernel
def lower_end(world):
    return lower_end_of(world, PEG)


@kernel
def depth(world):
    return depth_in(world, PEG, HOLE)


@kernel
def axis_of(world, peg):
    """Unit vector along the peg of a site, world frame, from its lower to its upper end."""
    axis = column(site_mat(world, peg), 2)
    return scale(-1.0, axis) if axis[2] < 0.0 else axis


@kernel
def lower_end_of(world, peg):
    """Tip of its nose that is lower, world frame, m."""
    return sub(site_pos(world, peg), scale(0.5 * PEG_LENGTH_M, axis_of(world, peg)))


@kernel
def upper_end_of(world, peg):
    """Tip of its nose that is higher, world frame, m."""
    return add(site_pos(world, peg), scale(0.5 * PEG_LENGTH_M, axis_of(world, peg)))


@kernel
def depth_in(world, peg, hole):
    """Length of its full width inside the bore of another site, below the chamfer, m; 0 outside."""
    axis = axis_of(world, peg)
    nose = sub(add(lower_end_of(world, peg), scale(PEG_RADIUS_M, axis)), site_pos(world, hole))  # centre of its sphere
    entering = sub(nose, scale(nose[2] / max(axis[2], 1e-3), axis))  # where the peg's axis enters the bore
    if max(planar_norm(nose), planar_norm(entering)) > OFF_AXIS_M or -nose[2] > DEEPEST_M:
        return 0.0
    return max(-nose[2], 0.0)


TASK = InsertPeg(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, lost=lost))

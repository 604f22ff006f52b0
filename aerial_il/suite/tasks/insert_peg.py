"""Insert a peg: take it out of its stand and push it into a bore that is 2 mm wider."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length, planar_length
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.abilities import obstacle_to_holding_upright
from aerial_il.suite.contact_sensors import GRIPPER, add_contact_sensor, add_force_sensor
from aerial_il.suite.props import FALLEN_M, TABLE_HEIGHT_M, add_table
from aerial_il.suite.props.peg import FLOOR_M, PEG_LENGTH_M, PEG_RADIUS_M, add_peg, add_socket
from aerial_il.suite.props.place import place, two_places
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

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


class InsertPeg(Task):
    """Round-nosed peg of 20 mm in an octagonal bore 22 mm across flats (1 mm of play all round), chamfered 5 mm.

    Solved when 30 mm of its full width are in the bore, below the chamfer, for 0.5 s, held or not: both where it enters
    the bore and at its lower nose its axis is within 4 mm of the bore's, and its nose is not deeper than the bottom. It
    stands loosely in a stand at the start; one that lies on the table may be picked up. Either end may go first.

    A peg whose middle is more than 10 cm below the table's surface, on the floor or on its way there, and that is not
    in the gripper is lost: the episode ends as dropped.
    """

    name = "insert_peg"
    grade = "hard"
    instruction = "Take the orange peg out of its stand and insert it into the blue socket."
    time_limit_s = 40.0
    dwell_s = 0.5
    subtasks = ("at_peg", "grasped", "lifted", "over_hole", "in_hole", "inserted")
    force_sensors = ("wrist_force",)

    def obstacle_to(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.0 * PEG_RADIUS_M + ROOM_FOR_ERRORS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the peg needs {100 * needed:.1f} cm"
        return obstacle_to_holding_upright(robot)

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
        xyz = ("x", "y", "z")
        return (
            Field("peg_pos", (3,), "task", unit="m", labels=xyz),
            Field("peg_axis", (3,), "task", labels=xyz),
            Field("hole_pos", (3,), "task", unit="m", labels=xyz),
            Field("stand_pos", (3,), "task", unit="m", labels=xyz),
            Field("tool_to_peg", (3,), "task", unit="m", labels=xyz),
            Field("end_to_hole", (3,), "task", unit="m", labels=xyz),
            Field("wrist_force", (3,), "task", unit="N", labels=xyz),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        peg, hole = view.site_pos("peg"), view.site_pos("hole")
        return {
            "peg_pos": peg.copy(),
            "peg_axis": peg_axis(view),
            "hole_pos": hole.copy(),
            "stand_pos": view.site_pos("stand").copy(),
            "tool_to_peg": peg - view.tool_pos,
            "end_to_hole": hole - lower_end(view),
            "wrist_force": view.force().copy(),
        }

    def solved(self, view: View) -> np.ndarray:
        return (depth(view) >= INSERTED_M) & (view.unwanted_contacts == 0)

    def lost(self, view: View) -> np.ndarray:
        return (view.site_pos("peg")[:, 2] < TABLE_HEIGHT_M - FALLEN_M) & ~self.grasped(view)

    def progress(self, view: View) -> np.ndarray:
        grasped, end, hole = self.grasped(view), lower_end(view), view.site_pos("hole")
        lifted = grasped & (end[:, 2] >= view.site_pos("stand")[:, 2] + LIFTED_M)
        over = grasped & (planar_length(end - hole) <= OVER_HOLE_M) & (end[:, 2] >= hole[:, 2] - PEG_RADIUS_M)
        near = length(upper_end(view) - view.tool_pos) <= 2.0 * GRASP_M
        return np.stack([near, grasped, lifted, over, depth(view) > 0.0, depth(view) >= INSERTED_M], axis=1)

    def reward(self, view: View) -> np.ndarray:
        end, hole = lower_end(view), view.site_pos("hole")
        near = closeness(length(upper_end(view) - view.tool_pos), 0.2)
        lifted = np.clip((end[:, 2] - TABLE_HEIGHT_M) / (FLOOR_M + STAND_DEPTH_M + LIFTED_M), 0.0, 1.0)
        beside = planar_length(end - hole)
        carrying = 0.3 + 0.1 * lifted + 0.1 * closeness(beside, 0.15) + 0.1 * closeness(beside, 0.01)
        inserted = np.clip(depth(view) / INSERTED_M, 0.0, 1.0)
        reward = np.where(self.grasped(view), carrying, 0.3 * near)
        return np.where(depth(view) > 0.0, 0.6 + 0.4 * inserted, reward)

    def grasped(self, view: View) -> np.ndarray:
        """(n,) bool: both pads touch the peg."""
        return view.touching("grip_left") & view.touching("grip_right")


def peg_axis(view: View) -> np.ndarray:
    """(n, 3) unit vector along the peg, world, from its lower to its upper end."""
    axis = view.site_mat("peg")[:, 2::3]
    return np.where(axis[:, 2:] < 0.0, -axis, axis)


def lower_end(view: View) -> np.ndarray:
    """(n, 3) tip of the nose that is lower, world, m."""
    return view.site_pos("peg") - 0.5 * PEG_LENGTH_M * peg_axis(view)


def upper_end(view: View) -> np.ndarray:
    """(n, 3) tip of the nose that is higher, world, m."""
    return view.site_pos("peg") + 0.5 * PEG_LENGTH_M * peg_axis(view)


def depth(view: View) -> np.ndarray:
    """(n,) length of the peg's full width inside the bore, below the chamfer, m; 0 outside."""
    axis, hole = peg_axis(view), view.site_pos("hole")
    nose = lower_end(view) + PEG_RADIUS_M * axis - hole  # the centre of its sphere, from the bore's mouth
    below = -nose[:, 2]
    entering = nose[:, :2] + (below / np.maximum(axis[:, 2], 1e-3))[:, None] * axis[:, :2]
    inside = (planar_length(nose) <= OFF_AXIS_M) & (planar_length(entering) <= OFF_AXIS_M) & (below <= DEEPEST_M)
    return np.where(inside, np.maximum(below, 0.0), 0.0)


TASK = InsertPeg()

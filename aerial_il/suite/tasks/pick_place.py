"""Pick and place: take a cube off the table and let go of it inside the bowl."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length, planar_length
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.contact_sensors import add_contact_sensor, add_touch_sensor
from aerial_il.suite.props import CUBE_HALF_M, FALLEN_M, TABLE_HEIGHT_M, add_bowl, add_cube, add_table
from aerial_il.suite.props.place import two_places
from aerial_il.suite.tasks.task import Task, hover_start, pointing_down
from aerial_il.suite.view import View

IN_BOWL_M = 0.05  # horizontal distance between cube and bowl
LOW_IN_BOWL_M, HIGH_IN_BOWL_M = 0.02, 0.05  # over the bowl's underside; 0.028 lying in it, 0.055 lying on its rim
AT_REST_M_S = 0.05
CLEAR_OF_CUBE_M = 0.10
LIFTED_M = 0.06
AREA_LOW, AREA_HIGH = np.array([-0.25, -0.35]), np.array([0.25, 0.35])
APART_M = 0.22
HEADROOM_M = 0.27  # above the table, that carrying and backing off take
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.1]), np.array([0.3, 0.3, 1.4])


class PickPlace(Task):
    """Cube released in the bowl within 5 cm, slower than 5 cm/s, gripper at least 10 cm away, for 0.5 s.

    In the bowl: the cube's centre is at most 5 cm beside the bowl's axis and 2 to 5 cm over its underside, so neither
    on the rim nor under the table. Released: no part of the robot touches it.

    A cube more than 10 cm below the table's surface, on the floor or on its way there, that is not in the gripper is
    lost: the episode ends as dropped. So is one that lies still where an arm on a fixed base is too short to get to.
    """

    name = "pick_place"
    grade = "medium"
    instruction = "Pick up the orange cube and place it in the blue bowl."
    time_limit_s = 30.0
    dwell_s = 0.5
    subtasks = ("at_cube", "grasped", "lifted", "over_bowl", "in_bowl")

    needs_flight = False

    def obstacle_to(self, robot: Robot) -> str | None:
        opening = 2.0 * robot.gripper.stroke
        if opening < 2.4 * CUBE_HALF_M:
            return f"its gripper opens {100 * opening:.1f} cm, the cube needs {240 * CUBE_HALF_M:.1f} cm"
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_cube(spec)
        add_bowl(spec)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "cube"))
        add_touch_sensor(spec, "robot_on_cube", "cube")

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        workable = partial(_workable, view.robot)
        cube, bowl = two_places(rng, AREA_LOW, AREA_HIGH, apart=APART_M, workable=workable)
        yaw = rng.uniform(-np.pi, np.pi)
        pose, _ = view.free_joint("cube")
        view.qpos[world, pose] = [*cube, TABLE_HEIGHT_M + CUBE_HALF_M, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
        view.mocap_pos[world, view.mocap_id("bowl")] = [*bowl, TABLE_HEIGHT_M]

    def fields(self) -> tuple[Field, ...]:
        xyz = ("x", "y", "z")
        return (
            Field("cube_pos", (3,), "task", unit="m", labels=xyz),
            Field("cube_heading", (2,), "task", labels=("cos4", "sin4")),
            Field("bowl_pos", (3,), "task", unit="m", labels=xyz),
            Field("tool_to_cube", (3,), "task", unit="m", labels=xyz),
            Field("cube_to_bowl", (3,), "task", unit="m", labels=xyz),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        cube, bowl = view.site_pos("cube"), view.site_pos("bowl")
        return {
            "cube_pos": cube.copy(),
            "cube_heading": cube_heading(view),
            "bowl_pos": bowl.copy(),
            "tool_to_cube": cube - view.tool_pos,
            "cube_to_bowl": bowl - cube,
        }

    def solved(self, view: View) -> np.ndarray:
        _, speed = view.free_joint("cube")
        slow = length(view.qvel[:, speed][:, :3]) <= AT_REST_M_S
        clear = length(view.site_pos("cube") - view.tool_pos) >= CLEAR_OF_CUBE_M
        released = clear & ~view.touching("robot_on_cube")
        return _in_bowl(view) & slow & released & (view.unwanted_contacts == 0)

    def lost(self, view: View) -> np.ndarray:
        _, speed = view.free_joint("cube")
        cube, still = view.site_pos("cube"), length(view.qvel[:, speed][:, :3]) <= AT_REST_M_S
        fallen = cube[:, 2] < TABLE_HEIGHT_M - FALLEN_M
        too_far = still & (length(cube - view.base_pos) > view.robot.longest_reach)
        return (fallen | too_far) & ~self.grasped(view)

    def progress(self, view: View) -> np.ndarray:
        cube, bowl = view.site_pos("cube"), view.site_pos("bowl")
        grasped = self.grasped(view)
        lifted = grasped & (cube[:, 2] >= TABLE_HEIGHT_M + CUBE_HALF_M + LIFTED_M)
        over = lifted & (planar_length(cube - bowl) <= IN_BOWL_M)
        return np.stack([length(cube - view.tool_pos) <= 0.03, grasped, lifted, over, _in_bowl(view)], axis=1)

    def reward(self, view: View) -> np.ndarray:
        cube, bowl = view.site_pos("cube"), view.site_pos("bowl")
        near = closeness(length(cube - view.tool_pos), 0.2)
        home = closeness(planar_length(cube - bowl), 0.15)
        carrying = 0.4 + 0.15 * home + 0.15 * np.clip((cube[:, 2] - TABLE_HEIGHT_M - CUBE_HALF_M) / LIFTED_M, 0.0, 1.0)
        clear = np.clip(length(cube - view.tool_pos) / CLEAR_OF_CUBE_M, 0.0, 1.0)
        reward = np.where(self.grasped(view), carrying, 0.3 * near)
        return np.where(_in_bowl(view), 0.75 + 0.25 * clear, reward)

    def grasped(self, view: View) -> np.ndarray:
        """(n,) bool: both pads touch the cube."""
        return view.touching("grip_left") & view.touching("grip_right")


def cube_heading(view: View) -> np.ndarray:
    """(n, 2) cosine and sine of four times the cube's yaw: the same for every face that could be gripped."""
    mat = view.site_mat("cube")
    c, s = mat[:, 0], mat[:, 3]
    norm = np.sqrt(c * c + s * s) + 1e-9
    c, s = c / norm, s / norm
    c2, s2 = c * c - s * s, 2.0 * c * s
    return np.stack([c2 * c2 - s2 * s2, 2.0 * c2 * s2], axis=1)


def _in_bowl(view: View) -> np.ndarray:
    cube, bowl = view.site_pos("cube"), view.site_pos("bowl")
    height = cube[:, 2] - bowl[:, 2]
    return (planar_length(cube - bowl) <= IN_BOWL_M) & (height >= LOW_IN_BOWL_M) & (height <= HIGH_IN_BOWL_M)


def _workable(robot: Robot, place: np.ndarray) -> bool:
    """Whether the tool can go down at a place (2,) m of the table, from as high as it travels."""
    heights = (TABLE_HEIGHT_M + 0.5 * CUBE_HALF_M, TABLE_HEIGHT_M + HEADROOM_M)
    return all(robot.reachable(np.array([*place, height]), pointing_down(0.0)) for height in heights)


TASK = PickPlace()

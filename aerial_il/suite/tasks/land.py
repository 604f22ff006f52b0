"""Land: come down on a pad, softly, and stay."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import closeness, norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, ROBOT, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    base_mat,
    base_pos,
    force,
    free_vel,
    site_pos,
    task_state,
    touching,
    untouched,
)
from aerial_il.suite.props.pad import add_pad
from aerial_il.suite.props.place import place
from aerial_il.suite.props.skids import STAND_M, add_skids
from aerial_il.suite.tasks.fields import GIVEN, OWN, felt, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

ON_PAD_M, UPRIGHT_COS, STILL_M_S = 0.10, math.cos(math.radians(5.0)), 0.05
LEAST_LOAD = 0.2  # share of the weight that the skids must carry: who only grazes the ground has not landed
# PX4 lands at MPC_LAND_SPEED, 0.7 m/s unless set otherwise (parameter reference of its documentation).
SOFT_M_S = 0.7
PAD_LOW, PAD_HIGH = np.array([-0.3, -0.3]), np.array([0.3, 0.3])
ASIDE_M, HEIGHT_M, HEADING_RANGE_RAD = 0.4, (0.8, 1.1), (-0.8, 0.8)
PAD = BASE = SKIDS = 0  # site; joint; contact sensor
SINKING, HARDEST = range(2)  # what is remembered: speed of descent in the air; the largest at which it has touched


class Land(Task):
    """On its skids within 10 cm of the pad's centre, upright and at rest for 0.5 s; it never came down hard.

    At rest: slower than 5 cm/s, within 5° of upright, with at least a fifth of its weight on the skids. A touchdown is
    hard above a sink rate of 0.7 m/s, measured in the control step (20 ms) before contact. A hub or a rotor that
    strikes the ground is a crash.

    It starts hovering, 0.8 to 1.1 m above the ground and up to 0.4 m to the side.
    """

    name = "land"
    grade = "easy"
    instruction = "Land softly in the middle of the pad."
    wordings = ("Land on the pad.", "Come down on the landing pad.", "降落在停机坪上。", "落到垫子上。")
    held_out = ("Land softly on the pad.", "请降落。")
    time_limit_s = 20.0
    dwell_s = 0.5
    needs_arm = False
    scene_height_m = 0.5
    subtasks = ("over_pad", "half_way_down", "touched", "standing", "soft")
    once_lost = ("soft",)
    names = Names(sites=("pad",), joints=("base",), contacts=("skids_contact",))
    force_sensors = ("ground_force",)
    commanded = ("pad",)
    privileged = (("ground_force", CONTACT_ALONE),)

    def own_infeasibility(self, robot: Robot) -> str | None:
        return "its arm is where the landing gear would be" if robot.num_joints else None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_pad(spec, tolerance=ON_PAD_M)
        add_skids(spec)
        add_force_sensor(spec, "ground_force", ROBOT)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        pad, angle = rng.uniform(PAD_LOW, PAD_HIGH), rng.uniform(-np.pi, np.pi)
        place(view, world, "pad", np.array([*pad, 0.0]), yaw=rng.uniform(-np.pi, np.pi))
        aside = rng.uniform(0.0, ASIDE_M) * np.array([np.cos(angle), np.sin(angle)])
        hover_start(view, world, np.array([*(pad + aside), rng.uniform(*HEIGHT_M)]), rng.uniform(*HEADING_RANGE_RAD))

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("pad_pos", "middle of the pad", noise=GIVEN),
            seen("skids_to_pad", "from the middle between the skids to that of the pad", noise=OWN),
            felt("ground_force", "contact force of the skids on what they stand on", real=False),
        )


@kernel
def observe(world, found):
    put(found, 0, site_pos(world, PAD))
    put(found, 3, to_pad(world))
    put(found, 6, force(world, 0))


@kernel
def remember(world):
    """Note how fast it was sinking when it touched, and how fast it sinks in the air."""
    state = task_state(world)
    if touching(world, SKIDS):
        state[HARDEST] = max(state[HARDEST], state[SINKING])
        state[SINKING] = 0.0
    else:
        state[SINKING] = max(0.0, -free_vel(world, BASE)[2])


@kernel
def solved(world):
    return standing(world) and soft(world) and untouched(world)


@kernel
def progress(world, flags):
    away = to_pad(world)
    flags[0], flags[1] = aside(world) <= ON_PAD_M, -away[2] <= 0.5
    flags[2], flags[3], flags[4] = touching(world, SKIDS), standing(world), soft(world)


@kernel
def reward(world):
    height = max(0.0, -to_pad(world)[2])
    over = 0.5 * closeness(aside(world), 0.3) + 0.5 * closeness(aside(world), 0.5 * ON_PAD_M)
    down = 0.5 * closeness(height, 0.3) + 0.3 * closeness(height, 0.05) + (0.2 if standing(world) else 0.0)
    return over * (0.2 + 0.8 * down) * (1.0 if soft(world) else 0.5)


@kernel
def to_pad(world):
    """From the middle between the skids' undersides to that of the pad, m."""
    away = sub(site_pos(world, PAD), base_pos(world))
    return (away[0], away[1], away[2] + STAND_M)


@kernel
def aside(world):
    """Horizontal distance from the pad's centre, m."""
    away = to_pad(world)
    return math.sqrt(away[0] * away[0] + away[1] * away[1])


@kernel
def standing(world):
    """Whether it stands on the pad, at rest."""
    upright, still = base_mat(world)[8] >= UPRIGHT_COS, norm(free_vel(world, BASE)) <= STILL_M_S
    loaded = touching(world, SKIDS) and norm(force(world, 0)) >= LEAST_LOAD * world.weight
    return aside(world) <= ON_PAD_M and upright and still and loaded


@kernel
def soft(world):
    """Whether it has not come down hard so far."""
    return task_state(world)[HARDEST] <= SOFT_M_S


TASK = Land(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember))

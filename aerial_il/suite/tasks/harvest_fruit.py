"""Harvest fruit: pull a ripe fruit off its stem, leave the unripe ones, and let go of it in the basket."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.contact_sensors import (
    CONTACT_ALONE,
    GRIPPER,
    add_contact_sensor,
    add_force_sensor,
    add_touch_sensor,
)
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    force,
    free_vel,
    reading,
    set_point,
    site_mat,
    site_pos,
    task_state,
    tool_pos,
    touching,
    untouched,
)
from aerial_il.suite.props import FALLEN_M, TABLE_HEIGHT_M, add_bowl, add_table
from aerial_il.suite.props.fruit import FRUIT_M, RADIUS_M, SNAP_M, STEM_N, add_plant, grow
from aerial_il.suite.props.place import places_apart
from aerial_il.suite.tasks.fields import GIVEN, direction, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

IN_BASKET_M = 0.055  # horizontal distance between the middles of fruit and basket
LOW_M, HIGH_M = 0.024, 0.05  # of a fruit's middle over the basket's underside; 0.030 lying in it
AT_REST_M_S = 0.05
CLEAR_OF_FRUIT_M = 0.10
AT_FRUIT_M = 0.03
LIFTED_M = 0.05  # of a fruit's middle above where it grew
RESERVE_SHARE = 0.5  # of the thrust beyond a robot's weight that it pulls up with
PLANTS_LOW, PLANTS_HIGH = np.array([-0.25, -0.36]), np.array([0.25, 0.10])
BASKET_LOW, BASKET_HIGH = np.array([-0.20, 0.28]), np.array([0.20, 0.38])
APART_M = 0.15
LEAF_YAW_RAD = np.deg2rad(45.0)  # either way of the x axis, before or behind its fruit
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.2]), np.array([0.3, 0.3, 1.4])
RIPE, UNRIPE = ("ripe_a", "ripe_b"), ("unripe_a", "unripe_b")
FRUITS = (*RIPE, *UNRIPE)  # sites, actuators, and the first sensors; the ripe ones are joints too
COUNT, RIPE_COUNT, BASKET, FIRST_PLANT = len(FRUITS), len(RIPE), len(FRUITS), len(FRUITS) + 1
FINGER_LEFT, FINGER_RIGHT, ROBOT_ON_RIPE = COUNT, COUNT + 1, COUNT + 2  # contacts; the last of as many as are ripe


class HarvestFruit(Task):
    """One of the two ripe fruits off its stem and let go of in the basket, no unripe one off, for 0.5 s.

    In the basket: its middle is at most 5.5 cm from the basket's axis and 2.4 to 5 cm above its underside; it is slower
    than 5 cm/s. Let go of: no part of the robot touches it, and the tool is at least 10 cm away; links and rotors touch
    nothing. Either ripe fruit will do.

    A fruit of 44 mm and 50 g sits on its calyx beside a leaf that may hide it, a thin flap on a hinge with a spring.
    Its stem stretches by 25 mm before it breaks, at 6 N, for good. An unripe fruit off its stem, or no ripe one left
    above 10 cm below the table's surface or in the gripper, ends the episode as dropped.
    """

    name = "harvest_fruit"
    grade = "hard"
    instruction = "Pull a red fruit off its stem and drop it in the blue basket; leave the green ones on theirs."
    wordings = (
        "Harvest one ripe fruit and put it in the basket.",
        "Pick a red fruit from its plant and drop it into the basket, without tearing off a green one.",
        "摘下一个红色的果实，放进蓝色篮子，不要碰掉绿色的。",
        "采摘成熟的果实，放入篮中。",
    )
    held_out = ("Pick one ripe red fruit and drop it in the basket.", "请采摘红色果实放到篮子里。")
    time_limit_s = 40.0
    dwell_s = 0.5
    subtasks = ("at_ripe", "grasped", "picked", "lifted", "over_basket", "in_basket")
    names = Names(
        sites=(*FRUITS, "basket", *(f"plant_{name}" for name in RIPE)),
        joints=RIPE,
        contacts=(
            *(f"stem_{name}" for name in FRUITS),
            "finger_left",
            "finger_right",
            *(f"robot_on_{name}" for name in RIPE),
        ),
        actuators=tuple(f"stem_{name}" for name in FRUITS),
    )
    force_sensors = ("wrist_force",)
    privileged = (("wrist_force", CONTACT_ALONE),)
    commanded = ("basket",)
    sight = (6, 28)

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.4 * RADIUS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the fruit needs {100 * needed:.1f} cm"
        vehicle = robot.vehicle
        lift = float(np.min(vehicle.rotor_max / np.maximum(vehicle.mixer[:, 2], 1e-9)))
        strength = RESERVE_SHARE * (lift - vehicle.mass * GRAVITY)
        if strength < STEM_N:
            return f"half of its thrust beyond its weight is {strength:.1f} N, and the stem holds until {STEM_N:.0f} N"
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE  # a fifth less time a step: many bodies, few contacts
        add_table(spec)
        for name in FRUITS:
            add_plant(spec, name, ripe=name in RIPE)
        add_bowl(spec, "basket", radius=0.08, wall=0.045)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"finger_{side}", body=f"finger_{side}")
        for name in RIPE:
            add_touch_sensor(spec, f"robot_on_{name}", name)
        add_force_sensor(spec, "wrist_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        side = rng.choice([-1.0, 1.0])  # of the table on which the basket stands
        places = places_apart(rng, PLANTS_LOW, PLANTS_HIGH, COUNT, apart=APART_M) * [1.0, side]
        for name, pos in zip(FRUITS, places, strict=True):
            grow(view, world, name, pos, rng.uniform(-LEAF_YAW_RAD, LEAF_YAW_RAD) + np.pi * rng.integers(2))
        basket = rng.uniform(BASKET_LOW, BASKET_HIGH) * [1.0, side]
        view.mocap_pos[world, view.mocap_id("basket")] = [*basket, TABLE_HEIGHT_M]

    def fields(self) -> tuple[Field, ...]:
        return (
            *(seen(f"{name}_pos", "middle of a fruit") for name in FRUITS),
            *(seen(f"tool_to_{name}", "from the tool to a ripe fruit") for name in RIPE),
            *(seen(f"{name}_to_basket", "from a ripe fruit to the basket") for name in RIPE),
            seen("basket_pos", "middle of the basket, at its underside", noise=GIVEN),
            seen("picked", "of each ripe fruit, 1 once it is off its stem", 2, unit="", frame="", labels=("a", "b")),
            *(direction(f"{name}_leaf", "of twice the yaw of its leaf", labels=("cos2", "sin2")) for name in RIPE),
            wrist_force(),
        )


@kernel
def observe(world, found):
    tool, basket = tool_pos(world), site_pos(world, BASKET)
    for k in range(COUNT):
        put(found, 3 * k, site_pos(world, k))
    for k in range(RIPE_COUNT):
        put(found, 12 + 3 * k, sub(site_pos(world, k), tool))
        put(found, 18 + 3 * k, sub(basket, site_pos(world, k)))
        found[27 + k] = task_state(world)[k]
        found[29 + 2 * k], found[30 + 2 * k] = leaf_heading(world, k)
    put(found, 24, basket)
    put(found, 33, force(world, 0))


@kernel
def remember(world):
    """Break the stems that are pulled at too hard."""
    broken = task_state(world)
    for k in range(COUNT):
        if reading(world, k) > SNAP_M:
            broken[k] = 1.0
            set_point(world, k)[0] = 0.0


@kernel
def solved(world):
    count = 0
    for k in range(RIPE_COUNT):
        count += harvested(world, k)
    return count > 0 and untouched(world) and not spoiled(world)


@kernel
def lost(world):
    gone = True
    for k in range(RIPE_COUNT):
        gone = gone and fallen(world, k) and not grasped(world, k)
    return gone or spoiled(world)


@kernel
def progress(world, flags):
    flags[:] = 0.0
    for k in range(RIPE_COUNT):
        fruit, held, off = site_pos(world, k), grasped(world, k), task_state(world)[k] > 0.0
        over = planar_norm(sub(fruit, site_pos(world, BASKET))) <= IN_BASKET_M
        high = fruit[2] >= TABLE_HEIGHT_M + FRUIT_M + LIFTED_M
        either(flags, 0, norm(sub(fruit, tool_pos(world))) <= AT_FRUIT_M)
        either(flags, 1, held)
        either(flags, 2, off)
        either(flags, 3, held and off and high)
        either(flags, 4, held and off and over)
        either(flags, 5, in_basket(world, k))


@kernel
def either(flags, k, holds):
    """Set a flag if something holds, and leave it as it is otherwise."""
    if holds:
        flags[k] = 1.0


@kernel
def reward(world):
    best = 0.0
    for k in range(RIPE_COUNT):
        best = max(best, reward_for(world, k))
    return 0.0 if spoiled(world) else best


@kernel
def reward_for(world, k):
    """Reward for how far one ripe fruit has come."""
    fruit = site_pos(world, k)
    away = norm(sub(fruit, tool_pos(world)))
    if in_basket(world, k):
        return 0.8 + 0.2 * clip(away / CLEAR_OF_FRUIT_M, 0.0, 1.0)
    if grasped(world, k):
        beside = planar_norm(sub(fruit, site_pos(world, BASKET)))
        return 0.3 + 0.2 * task_state(world)[k] * (1.0 + closeness(beside, 0.15))
    return 0.3 * closeness(away, 0.2)


@kernel
def leaf_heading(world, k):
    """Cosine and sine of twice the yaw of a ripe fruit's leaf, which is on its plant's x axis."""
    mat = site_mat(world, FIRST_PLANT + k)
    return mat[0] * mat[0] - mat[3] * mat[3], 2.0 * mat[0] * mat[3]


@kernel
def spoiled(world):
    """Whether an unripe fruit has been torn off."""
    broken = 0.0
    for k in range(RIPE_COUNT, COUNT):
        broken += task_state(world)[k]
    return broken > 0.0


@kernel
def fallen(world, k):
    return site_pos(world, k)[2] < TABLE_HEIGHT_M - FALLEN_M


@kernel
def grasped(world, k):
    """Whether a ripe fruit is between the fingers, and both touch something."""
    near = norm(sub(site_pos(world, k), tool_pos(world))) <= AT_FRUIT_M
    return (
        near and touching(world, FINGER_LEFT) and touching(world, FINGER_RIGHT) and touching(world, ROBOT_ON_RIPE + k)
    )


@kernel
def in_basket(world, k):
    """Whether a ripe fruit lies in the basket, off its stem."""
    offset = sub(site_pos(world, k), site_pos(world, BASKET))
    within = planar_norm(offset) <= IN_BASKET_M and LOW_M <= offset[2] <= HIGH_M
    return within and task_state(world)[k] > 0.0


@kernel
def harvested(world, k):
    """Whether a ripe fruit lies still in the basket, let go of."""
    clear = norm(sub(site_pos(world, k), tool_pos(world))) >= CLEAR_OF_FRUIT_M
    still = norm(free_vel(world, k)) <= AT_REST_M_S
    return in_basket(world, k) and still and clear and not touching(world, ROBOT_ON_RIPE + k)


TASK = HarvestFruit(
    TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember, lost=lost)
)

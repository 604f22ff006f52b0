"""Wipe a window: slide the closed gripper over every patch of dirt on a steep pane, pressing with a given force."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, closeness, norm, rotate, rotate_back, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pressing
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, ROBOT, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    force,
    force_sample,
    gripper_opening,
    mocap_pos_after,
    put_rot6d,
    raw_force_sample,
    site_mat,
    site_pos,
    task_state,
    tip_pos,
    untouched,
)
from aerial_il.suite.props.dirt import CELLS, COLUMNS, PATCHES, cell_middle, connected_shape, count, without_cells_near
from aerial_il.suite.props.place import place
from aerial_il.suite.props.window import PANE_HALF_M, add_window
from aerial_il.suite.tasks.fields import EXACT, felt, seen, wrist_force
from aerial_il.suite.tasks.inspect_contact import (
    FORCE_N,
    FORCE_TOLERANCE_N,
    along_normal,
    at_force,
    in_band,
    normal_force,
)
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S, SUBSTEPS

BREAKING_N = 15.0
WIPED_SHARE = 0.9
WIPED_M = 0.025  # from the fingertips to the middle of a patch
SLIDING_M_S, SLIDING_S = 0.04, 0.2  # a hand that trembles is faster, but not for so long
ON_PANE_M = 0.02  # of the fingertips from the face
CLOSED_SHARE = 0.2  # of its stroke
TOUCH_N = 0.5  # normal force at which contact begins and ends
WINDOW_LOW, WINDOW_HIGH = np.array([0.20, -0.20, 0.75]), np.array([0.40, 0.20, 0.90])
TILT_RANGE_RAD, YAW_RANGE_RAD = (0.9, 1.2), (-0.7, 0.1)  # seen from behind, but never edge on
START_LOW, START_HIGH = np.array([-0.75, -0.25, 1.1]), np.array([-0.55, 0.25, 1.3])
DIRTY, LEFT, BROKEN, TOUCHED = range(4)  # in the task's state: cells with dirt, as bits, at the start and now; flags
TRAIL, PRESSED, IN_BAND = 4, 6, 7  # point that trails the fingertips, m (2); physics steps in contact, in the band
TRAIL_SHARE = 1.0 - math.exp(-CONTROL_DT_S / SLIDING_S)
PANE, WINDOW = 0, 0  # site, mocap body; the pane and the force on it are numbered as the plate of `inspect_contact`
ON_WINDOW, BY_TOOL = range(2)  # forces: on the pane, and what a sensor in the wrist feels
GONE = (0.0, 0.0, -1.0)  # where dirt is that has been wiped off, m


class WipeWindow(Task):
    """At least 13 of 14 patches of dirt wiped off, the pane whole, and nothing but the gripper touched, for 0.5 s.

    A patch is wiped in a control step in which the fingertips slide over it: they pass within 2.5 cm of its middle at
    4 cm/s or more (as a first-order low-pass of 0.2 s has it), less than 2 cm from the pane, while every sample of the
    normal force is 5 ± 2 N; the gripper is open by a fifth at most, and links and rotors touch nothing. The force is
    that of all parts of the robot on the pane, sampled at each physics step (250 Hz) behind a first-order low-pass of
    15 Hz. ``force_in_band_raw`` is the share of the physics steps in contact in which the contact solver's own force
    was in that band.

    A sample above 15 N breaks the pane: the episode ends as dropped. The patches are squares of 4 cm, a random
    connected shape of 14 on a grid of 4 by 11. The pane is tilted by 52° to 69° towards the robot, sprung (it yields by
    7 mm per newton) and without friction, as soaped glass nearly is.
    """

    name = "wipe_window"
    grade = "hard"
    instruction = "Wipe the brown dirt off the window with the closed gripper, pressing with five newtons."
    wordings = (
        "Wipe the dirt off the pane with five newtons.",
        "Clean the window pane with the closed gripper.",
        "用合拢的夹爪以五牛的力擦净窗玻璃。",
        "把窗户上的污渍擦掉。",
    )
    held_out = (
        "Wipe the dirty pane clean.",
        "请擦干净窗户。",
    )
    time_limit_s = 60.0
    dwell_s = 0.5
    subtasks = ("at_dirt", "touching", "at_force", "half_wiped", "wiped")
    names = Names(sites=("pane",), mocaps=("window",))
    force_sensors = ("pane_force", "tool_force")
    asks_for_force = True
    privileged = (
        ("tool_force", CONTACT_ALONE),
        ("normal_force", "the force of the whole robot on the pane: measuring it takes a sensor behind the pane"),
    )

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_pressing(robot, FORCE_N)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_window(spec)
        add_force_sensor(spec, "pane_force", ROBOT, on="pane")
        add_force_sensor(spec, "tool_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        pos, yaw, tilt = rng.uniform(WINDOW_LOW, WINDOW_HIGH), rng.uniform(*YAW_RANGE_RAD), rng.uniform(*TILT_RANGE_RAD)
        place(view, world, "window", pos, yaw=yaw, pitch=-tilt)
        c, s, ct, st = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
        up, across, out = np.array([c * ct, s * ct, st]), np.array([-s, c, 0.0]), np.array([-c * st, -s * st, ct])
        place(view, world, "window_stand", pos - (PANE_HALF_M[0] + 0.02) * up - 0.02 * out)
        cells = connected_shape(rng)
        for k, cell in enumerate(cells):
            x, y = cell_middle(cell)
            there = pos + x * up + y * across - PANE_HALF_M[2] * out
            place(view, world, f"dirt_{k}", there, yaw=yaw, pitch=-tilt)
        view.task_state[world, [DIRTY, LEFT]] = float(sum(1 << cell for cell in cells))

    def fields(self) -> tuple[Field, ...]:
        cells = tuple(f"row_{k // COLUMNS}_column_{k % COLUMNS}" for k in range(CELLS))
        return (
            seen("pane_pos", "middle of the pane's face"),
            seen("pane_rot6d", "first two columns of the pane's rotation", 6, unit="", frame="world from pane"),
            seen("tip_on_pane", "fingertips from the middle of the pane", frame="pane: up, across, out"),
            seen("tip_to_dirt", "from the fingertips to the nearest patch of dirt; zero when there is none"),
            seen("dirt", "1 where dirt is left", CELLS, unit="", frame="pane", labels=cells, noise=EXACT),
            seen("wiped", "share of the dirt that has been wiped off", 1, unit="", labels=("share",), noise=EXACT),
            wrist_force("tool_force"),
            felt("normal_force", "force of the whole robot on the pane", 1, frame="along its normal", real=False),
        )


@kernel
def observe(world, found):
    put(found, 0, site_pos(world, PANE))
    put_rot6d(found, 3, site_mat(world, PANE))
    put(found, 9, tip_on_pane(world))
    put(found, 12, tip_to_dirt(world))
    left = int(task_state(world)[LEFT])
    for cell in range(CELLS):
        found[15 + cell] = left >> cell & 1
    found[15 + CELLS] = wiped_share(world)
    put(found, 16 + CELLS, force(world, BY_TOOL))
    found[19 + CELLS] = normal_force(world)


@kernel
def remember(world):
    state, tip, felt = task_state(world), tip_on_pane(world), normal_force(world) >= TOUCH_N
    if not in_touch(world):
        state[TRAIL], state[TRAIL + 1] = tip[0], tip[1]
    ahead_x, ahead_y = tip[0] - state[TRAIL], tip[1] - state[TRAIL + 1]
    if math.hypot(ahead_x, ahead_y) >= SLIDING_M_S * SLIDING_S and wiping(world):
        state[LEFT] = without_cells_near(int(state[LEFT]), tip, WIPED_M)
    state[TRAIL] += TRAIL_SHARE * ahead_x
    state[TRAIL + 1] += TRAIL_SHARE * ahead_y
    state[TOUCHED] = 1.0 if felt else 0.0
    for tick in range(SUBSTEPS):
        if along_normal(world, force_sample(world, tick)) > BREAKING_N:
            state[BROKEN] = 1.0
        if felt:
            state[PRESSED] += 1.0
            state[IN_BAND] += in_band(along_normal(world, raw_force_sample(world, tick)))
    show_dirt(world)


@kernel
def show_dirt(world):
    """Let the dirt move with the pane, and take away what has been wiped off; it touches nothing."""
    state, mat, face = task_state(world), site_mat(world, PANE), site_pos(world, PANE)
    dirty, left, k = int(state[DIRTY]), int(state[LEFT]), 1
    for cell in range(CELLS):
        if dirty >> cell & 1:
            x, y = cell_middle(cell)
            there = add(face, rotate(mat, (x, y, -PANE_HALF_M[2])))
            put(mocap_pos_after(world, WINDOW, k), 0, there if left >> cell & 1 else GONE)
            k += 1


@kernel
def solved(world):
    return wiped_share(world) >= WIPED_SHARE and not broken(world) and untouched(world)


@kernel
def broken(world):
    """Whether the pane has broken."""
    return task_state(world)[BROKEN] > 0.0


@kernel
def force_in_band_raw(world):
    state = task_state(world)
    return state[IN_BAND] / state[PRESSED] if state[PRESSED] > 0.0 else math.nan


@kernel
def progress(world, flags):
    share = wiped_share(world)
    flags[0] = norm(tip_to_dirt(world)) <= 2.0 * WIPED_M
    flags[1], flags[2] = in_touch(world), at_force(world)
    flags[3], flags[4] = share >= 0.5, share >= WIPED_SHARE


@kernel
def reward(world):
    share = wiped_share(world)
    if share >= WIPED_SHARE:
        return 1.0
    near = closeness(norm(tip_to_dirt(world)), 0.15)
    pressing = closeness(normal_force(world) - FORCE_N, FORCE_TOLERANCE_N) if in_touch(world) else 0.0
    return 0.15 * near + 0.15 * near * pressing + 0.6 * share


@kernel
def wiping(world):
    """Whether the gripper is on the pane as it must be to wipe it, whether it slides or not."""
    near = abs(tip_on_pane(world)[2]) <= ON_PANE_M
    return near and at_force(world) and gripper_opening(world) <= CLOSED_SHARE and untouched(world)


@kernel
def in_touch(world):
    """Whether the robot was in contact with the pane at the last control step."""
    return task_state(world)[TOUCHED] > 0.0


@kernel
def tip_on_pane(world):
    """Fingertips from the middle of the pane's face: up it, across it and out of it, m."""
    return rotate_back(site_mat(world, PANE), sub(tip_pos(world), site_pos(world, PANE)))


@kernel
def ahead_of_trail(world):
    """Fingertips from the point that trails them on the pane, world frame, m: along the way that they slide."""
    state, tip = task_state(world), tip_on_pane(world)
    return rotate(site_mat(world, PANE), (tip[0] - state[TRAIL], tip[1] - state[TRAIL + 1], 0.0))


@kernel
def tip_to_dirt(world):
    """From the fingertips to the middle of the nearest patch that is left, world frame, m; zero if there is none."""
    left, tip = int(task_state(world)[LEFT]), tip_on_pane(world)
    nearest, found = (0.0, 0.0, 0.0), False
    for cell in range(CELLS):
        if left >> cell & 1:
            x, y = cell_middle(cell)
            off = sub((x, y, 0.0), tip)
            if not found or norm(off) < norm(nearest):
                nearest, found = off, True
    return rotate(site_mat(world, PANE), nearest)


@kernel
def wiped_share(world):
    """Share of the dirt that has been wiped off."""
    return 1.0 - count(int(task_state(world)[LEFT])) / PATCHES


TASK = WipeWindow(
    TaskKernels(
        observe=observe,
        solved=solved,
        progress=progress,
        reward=reward,
        remember=remember,
        lost=broken,
        force_in_band_raw=force_in_band_raw,
    )
)

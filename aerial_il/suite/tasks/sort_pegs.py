"""Sort pegs: insert three pegs into the holes of their colours, in an order that lamps show at the start only."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_upright_hold
from aerial_il.suite.physics.contact_sensors import add_contact_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, mocap_pos, site_pos, task_state, tool_pos, touching, untouched
from aerial_il.suite.props import FALLEN_M, TABLE_HEIGHT_M, add_table
from aerial_il.suite.props.lamps import DARK_M, LAMPS_APART_M, LIT_M, PANEL_HALF_M, add_lamps
from aerial_il.suite.props.peg import FLOOR_M, PEG_LENGTH_M, PEG_RADIUS_M, add_cup, add_peg
from aerial_il.suite.props.place import place, places_apart
from aerial_il.suite.tasks.fields import EXACT, seen
from aerial_il.suite.tasks.insert_peg import (
    BORE_M,
    CLEARANCE_M,
    INSERTED_M,
    LIFTED_M,
    ROOM_FOR_ERRORS_M,
    STAND_CLEARANCE_M,
    STAND_DEPTH_M,
    axis_of,
    depth_in,
    lower_end_of,
    reward_for,
)
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S

COLOURS = {"red": (0.80, 0.13, 0.12, 1.0), "green": (0.12, 0.60, 0.25, 1.0), "blue": (0.16, 0.36, 0.80, 1.0)}
SHOWN_S = 2.0  # how long the lamps are lit
AREA_LOW, AREA_HIGH = np.array([-0.26, -0.32]), np.array([0.20, 0.32])
APART_M = 0.14  # between the axes of any two of stands and holes: an open gripper passes between two pegs
PANEL_POS = (0.345, 0.0, TABLE_HEIGHT_M + PANEL_HALF_M[2])
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.15]), np.array([0.2, 0.3, 1.35])
PEGS = 3  # sites, the first three; the hole of each follows PEGS later
TURN, IN, LIT, SPOILED = 0, 3, 6, 7  # in the task's state: turn of each peg, 1 to 3; whether it is in; steps; 0 or 1


class SortPegs(Task):
    """All three pegs 30 mm deep in the holes of their own colours, inserted in the order shown, for 0.5 s.

    Pegs, bores and depth are those of `insert_peg`: pegs 20 mm thick, bores 22 mm across flats, 30 mm of a peg's full
    width below the chamfer. Stands and holes are at random places, at least 14 cm apart. For the first 2 s three lamps
    show the order, the first on the left as the robot looks at the start, and `turn` shows it too; then the lamps go
    out and `turn` is zero: whoever inserts the second peg must remember.

    A peg is in once it has been 30 mm deep in its hole, and until it has come out of the bore. One that is 30 mm deep
    in another's hole, or comes to be in before those whose turn is earlier or after one whose turn is later, spoils the
    episode, which ends as dropped. So does a peg whose middle is more than 10 cm below the table's surface and that is
    not in the gripper.
    """

    name = "sort_pegs"
    grade = "hard"
    instruction = "Insert each peg into the socket of its colour, in the order that the lamps show from left to right."
    wordings = (
        "Insert the three pegs in the order of the lamps, each into the hole of its colour.",
        "Sort the pegs by colour, in the order that the lamps showed.",
        "按指示灯的顺序把三根插销插入同色的孔。",
        "按灯的次序将插销分别插进对应颜色的孔里。",
    )
    held_out = (
        "Put each peg into the hole of its own colour, in the order of the lamps.",
        "请按灯的顺序插好三根插销。",
    )
    time_limit_s = 60.0
    dwell_s = 0.5
    subtasks = ("first_lifted", "first_in", "second_lifted", "second_in", "third_lifted", "third_in")
    names = Names(
        sites=(*(f"peg_{name}" for name in COLOURS), *(f"hole_{name}" for name in COLOURS)),
        contacts=tuple(f"grip_{side}_{name}" for name in COLOURS for side in ("left", "right")),
        mocaps=tuple(f"lamp_{name}" for name in COLOURS),
    )
    commanded = names.mocaps
    sight = (6, 21)
    privileged = (
        *((f"{name}_peg_axis", "the fingers occlude a peg that they hold") for name in COLOURS),
        *((f"{name}_end_to_hole", f"follows from `{name}_peg_axis`") for name in COLOURS),
    )

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.0 * PEG_RADIUS_M + ROOM_FOR_ERRORS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the pegs need {100 * needed:.1f} cm"
        return infeasible_upright_hold(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # a peg in a bore is near to all its walls
        add_table(spec)
        add_lamps(spec, PANEL_POS, COLOURS)
        grey = [0.62, 0.62, 0.64, 1.0]
        for name, rgba in COLOURS.items():
            add_peg(spec, f"peg_{name}", rgba)
            radius = PEG_RADIUS_M + 0.5 * STAND_CLEARANCE_M
            add_cup(spec, f"stand_{name}", radius=radius, depth=STAND_DEPTH_M, rgba=grey, chamfer=False)
            radius = PEG_RADIUS_M + 0.5 * CLEARANCE_M
            add_cup(spec, f"hole_{name}", radius=radius, depth=BORE_M, rgba=rgba, chamfer=True)
            for side in ("left", "right"):
                add_contact_sensor(spec, f"grip_{side}_{name}", geoms=(f"pad_{side}", f"peg_{name}"))

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        places = places_apart(rng, AREA_LOW, AREA_HIGH, 2 * PEGS, apart=APART_M)
        state, turns = view.task_state[world], rng.permutation(PEGS)
        state[LIT] = round(SHOWN_S / CONTROL_DT_S)
        for name, turn, stand, hole in zip(COLOURS, turns, places[:PEGS], places[PEGS:], strict=True):
            place(view, world, f"stand_{name}", np.array([*stand, TABLE_HEIGHT_M]), yaw=rng.uniform(-np.pi, np.pi))
            place(view, world, f"hole_{name}", np.array([*hole, TABLE_HEIGHT_M]), yaw=rng.uniform(-np.pi, np.pi))
            pose, _ = view.free_joint(f"peg_{name}")
            view.qpos[world, pose] = [*stand, TABLE_HEIGHT_M + FLOOR_M + 0.5 * PEG_LENGTH_M, 1.0, 0.0, 0.0, 0.0]
            x, y, z = PANEL_POS
            place(view, world, f"lamp_{name}", np.array([x, y + (1 - turn) * LAMPS_APART_M, z + LIT_M]))
            state[TURN + list(COLOURS).index(name)] = turn + 1

    def fields(self) -> tuple[Field, ...]:
        of_pegs = (field for name in COLOURS for field in _fields_of(name))
        each = {"unit": "", "frame": "by peg", "labels": tuple(COLOURS), "noise": EXACT}
        return (
            *of_pegs,
            seen("turn", "of each peg, 1 to 3, in the first 2 s; then 0", **each),
            seen("is_in", "1 for each peg that is in its hole, else 0", **each),
        )


@kernel
def observe(world, found):
    state, tool = task_state(world), tool_pos(world)
    for k in range(PEGS):
        peg, hole = site_pos(world, k), site_pos(world, PEGS + k)
        put(found, 15 * k, peg)
        put(found, 15 * k + 3, axis_of(world, k))
        put(found, 15 * k + 6, hole)
        put(found, 15 * k + 9, sub(peg, tool))
        put(found, 15 * k + 12, sub(hole, lower_end_of(world, k)))
        found[45 + k] = state[TURN + k] if state[LIT] > 0.0 else 0.0
        found[48 + k] = state[IN + k]


@kernel
def remember(world):
    """Put the lamps out when their time is up; note which pegs are in, and whether that was their turn."""
    state = task_state(world)
    state[LIT] = max(state[LIT] - 1.0, 0.0)
    if state[LIT] == 0.0:
        for k in range(PEGS):
            mocap_pos(world, k)[2] = PANEL_POS[2] + DARK_M
    for turn in range(1, PEGS + 1):
        k = peg_of_turn(world, turn)
        inside = depth_in(world, k, PEGS + k)
        its_turn = number_in(world) == turn - 1 and next_peg(world) == k
        if inside >= INSERTED_M and state[IN + k] == 0.0:
            state[IN + k] = 1.0
            if not its_turn:
                state[SPOILED] = 1.0
        elif inside == 0.0:
            state[IN + k] = 0.0
        for other in range(PEGS):
            if other != k and depth_in(world, k, PEGS + other) >= INSERTED_M:
                state[SPOILED] = 1.0


@kernel
def solved(world):
    inserted = task_state(world)[SPOILED] == 0.0 and number_in(world) == PEGS
    for k in range(PEGS):
        inserted = inserted and depth_in(world, k, PEGS + k) >= INSERTED_M
    return inserted and untouched(world)


@kernel
def lost(world):
    fallen = False
    for k in range(PEGS):
        fallen = fallen or (site_pos(world, k)[2] < TABLE_HEIGHT_M - FALLEN_M and not grasped(world, k))
    return fallen or task_state(world)[SPOILED] > 0.0


@kernel
def progress(world, flags):
    over_stands = TABLE_HEIGHT_M + FLOOR_M + STAND_DEPTH_M + LIFTED_M
    for turn in range(1, PEGS + 1):
        k = peg_of_turn(world, turn)
        flags[2 * turn - 2] = grasped(world, k) and lower_end_of(world, k)[2] >= over_stands
        flags[2 * turn - 1] = task_state(world)[IN + k] > 0.0 and depth_in(world, k, PEGS + k) >= INSERTED_M


@kernel
def reward(world):
    k = next_peg(world)
    if task_state(world)[SPOILED] > 0.0:
        return 0.0
    rest = PEGS - number_in(world)
    return 1.0 - (rest - reward_for(world, k, PEGS + k, grasped(world, k)) * (rest > 0.0)) / PEGS


@kernel
def grasped(world, k):
    """Whether both pads touch peg ``k``."""
    return touching(world, 2 * k) and touching(world, 2 * k + 1)


@kernel
def number_in(world):
    """How many pegs are in."""
    state = task_state(world)
    return state[IN] + state[IN + 1] + state[IN + 2]


@kernel
def peg_of_turn(world, turn):
    """Number of the peg whose turn it is: 1, 2 or 3."""
    state, found = task_state(world), 0
    for k in range(PEGS):
        if state[TURN + k] == turn:
            found = k
    return found


@kernel
def next_peg(world):
    """Number of the peg that is to be inserted next; of the last one when all are in."""
    state, found = task_state(world), peg_of_turn(world, PEGS)
    for turn in range(PEGS, 0, -1):
        k = peg_of_turn(world, turn)
        if state[IN + k] == 0.0:
            found = k
    return found


def _fields_of(name: str) -> tuple[Field, ...]:
    return (
        seen(f"{name}_peg_pos", f"middle of the {name} peg"),
        seen(f"{name}_peg_axis", "unit vector from its lower end to its upper one", unit="", real=False),
        seen(f"{name}_hole_pos", "mouth of the hole in which it goes"),
        seen(f"tool_to_{name}_peg", "from the tool to its middle"),
        seen(f"{name}_end_to_hole", "from its lower end to its hole", real=False),
    )


TASK = SortPegs(
    TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember, lost=lost)
)

"""Numbers to fly by: every task has some, they say what the observation says, and they point where the sticks do."""

import math

import numpy as np
import pytest

import aerial_il
from aerial_il.core.rotations import mat_from_rotvec, mat_from_yaw, matmul, rotate
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.session.readings import readings_of
from tests.teleop.hands import first, schedule, shipped, world

XYZ = ("x", "y", "z")
TOOL = (Field("base_rot6d", (6,)), Field("ee_pos", (3,), unit="m", labels=XYZ), Field("ee_rot6d", (6,)))
DOWN = (0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0)  # a tool that points straight down


def rot6d(mat: tuple[float, ...]) -> np.ndarray:
    return np.array([*mat[0::3], *mat[1::3]])


def read(field: Field, value: object, *, yaw: float = 0.0, tool: tuple[float, ...] = DOWN) -> list[float]:
    """Return what is shown of one field on a vehicle that is heading for ``yaw``."""
    spec = ObservationSpec((*TOOL, field))
    obs = {
        "base_rot6d": rot6d(mat_from_yaw(yaw)),
        "ee_pos": np.array([1.0, 2.0, 0.5]),
        "ee_rot6d": rot6d(matmul(mat_from_yaw(yaw), tool)),
        field.name: np.atleast_1d(np.asarray(value, float)),
    }
    return readings_of(spec)[0].numbers(obs)


@pytest.mark.parametrize("task", aerial_il.list_tasks())
def test_every_task_has_numbers_from_its_observation_alone(task: str) -> None:
    able = [robot for robot, other in aerial_il.list_cells() if other == task]
    env = world("fa_hexa_arm4" if "fa_hexa_arm4" in able else able[0], task)
    readings, obs = readings_of(env.spec.observation), first(env.reset(5000))
    assert [r for r in readings if not r.title.startswith(("tool height", "tool points", "gripper"))]
    assert len({r.title for r in readings}) == len(readings)
    for reading in readings:
        numbers = reading.numbers(obs)
        assert len(numbers) == len(reading.poles)
        assert np.isfinite(numbers).all()
    env.close()


def test_offsets_are_along_the_heading_and_in_centimetres() -> None:
    cube = Field("tool_to_cube", (3,), "task", unit="m", labels=XYZ)
    assert read(cube, [0.1, 0.02, -0.3]) == [10.0, 2.0, -30.0]
    assert read(cube, [0.1, 0.02, -0.3], yaw=0.5 * math.pi) == [2.0, -10.0, -30.0]


def test_a_place_is_measured_from_the_tool() -> None:
    assert read(Field("stand_pos", (3,), "task", unit="m", labels=XYZ), [1.2, 2.0, 0.0]) == [20.0, 0.0, -50.0]
    pos = Field("cube_pos", (3,), "task", unit="m", labels=XYZ)
    offset = Field("tool_to_cube", (3,), "task", unit="m", labels=XYZ)
    assert [r.title for r in readings_of(ObservationSpec((*TOOL, pos, offset)))][:2] == ["tool to cube", "tool height"]


@pytest.mark.parametrize("yaw", [0.0, 1.3])
def test_turns_to_a_pose_are_those_of_the_wrist(yaw: float) -> None:
    target = Field("target_rot6d", (6,), "task")
    for axis, shown in (((0.0, 0.0, 1.0), [20.0, 0.0, 0.0]), ((0.0, 1.0, 0.0), [0.0, 20.0, 0.0])):
        turn = mat_from_rotvec(tuple(math.radians(20.0) * x for x in rotate(mat_from_yaw(yaw), axis)))
        assert read(target, rot6d(matmul(turn, matmul(mat_from_yaw(yaw), DOWN))), yaw=yaw) == shown


def test_a_thing_is_faced_squarely_whatever_its_yaw() -> None:
    plate = Field("plate_rot6d", (6,), "task")
    for yaw in (0.0, 1.0, 3.0):
        assert read(plate, rot6d(mat_from_yaw(yaw))) == [0.0, 0.0, 0.0], "a tool that points down faces a level plate"
    assert read(plate, rot6d(mat_from_rotvec((0.0, -0.3, 0.0)))) == [0.0, -17.0, 0.0], "nose up to one that leans back"


def test_a_cube_is_gripped_by_the_nearest_faces() -> None:
    cube = Field("cube_heading", (2,), "task", labels=("cos4", "sin4"))
    for degrees, shown in ((10, 10), (50, -40), (100, 10), (-30, -30)):
        angle = 4.0 * math.radians(degrees)
        assert read(cube, [math.cos(angle), math.sin(angle)]) == [shown]
        assert read(cube, [math.cos(angle + 4.0), math.sin(angle + 4.0)], yaw=1.0) == [shown]


def test_forces_are_lengths_and_angles_degrees() -> None:
    assert read(Field("tool_force", (3,), "task", unit="N", labels=XYZ), [3.0, 0.0, -4.0]) == [5.0]
    assert read(Field("door_angle", (1,), "task", unit="rad"), -math.pi / 6) == [-30.0]
    assert read(Field("peg_axis", (3,), "task", labels=XYZ), [0.0, math.sin(0.1), math.cos(0.1)]) == [6.0]
    assert readings_of(ObservationSpec((Field("lap", (4,), "task"),))) == (), "no guesses at what has no rule"


@pytest.mark.parametrize(
    ("key", "title", "index"),
    [
        ("forward+", "tool to target", 0),
        ("lateral+", "tool to target", 1),
        ("up+", "tool to target", 2),
        ("yaw+", "turn to target", 0),
    ],
)
def test_the_key_that_a_number_names_makes_it_smaller(key: str, title: str, index: int) -> None:
    """Flown on the real vehicle: half a second of a key, then the number has gone down, and its sign is the key's."""
    env, bindings = world(), shipped("scripted")
    obs = first(env.reset(5003))
    pilot = ManualPilot(env.spec, env.scenario.robot.vehicle, bindings)
    pilot.engage(obs)
    (reading,) = (r for r in readings_of(env.spec.observation) if r.title == title)
    before, device = reading.numbers(obs)[index], Scripted(schedule((0, 25, [key])), bindings)
    for _ in range(60):
        obs = first(env.step(pilot.act(device.frame(), obs)[None]).obs)
    assert reading.numbers(obs)[index] < before - 5.0
    env.close()

"""The way between two segments passes over what stands in between."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.data.dataset import open_dataset
from aerial_il.generation import generator
from aerial_il.generation.generator import Generator
from aerial_il.generation.source import read_sources
from aerial_il.generation.transit import CLEARANCE_M, Boxes, boxes, way
from aerial_il.suite.props import TABLE_HEIGHT_M
from aerial_il.suite.tasks import pick_place
from aerial_il.suite.tasks.pick_place import PickPlace

LEFT, RIGHT = np.array([0.0, 0.4, 0.2]), np.array([0.0, -0.4, 0.25])
WALL_M = 0.07  # half the height of a wall on the table


def standing(*walls: tuple[float, float]) -> Boxes:
    """Return walls across the way from left to right: how far left each is, and how high, m."""
    spec = mujoco.MjSpec()
    for left, height in walls:
        body = spec.worldbody.add_body(pos=[0.0, left, 0.5 * height])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.01, 0.5 * height])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return boxes(model, data)


def test_a_free_way_is_straight() -> None:
    for around in (standing((0.0, 0.1)), standing((0.39, 1.0)), standing((2.0, 1.0))):
        assert [point.tolist() for point in way(LEFT, RIGHT, around, ())] == [RIGHT.tolist()]


def test_the_way_passes_over_all_that_is_in_it() -> None:
    around = standing((0.1, 0.3), (0.05, 0.2), (0.3, 0.5))
    rise, sink, goal = way(LEFT, RIGHT, around, ())
    assert rise[2] == sink[2] == pytest.approx(0.5 + CLEARANCE_M)
    assert (rise[:2] == LEFT[:2]).all()
    assert (sink[:2] == RIGHT[:2]).all()
    assert (goal == RIGHT).all()


def test_what_is_carried_or_gone_to_is_not_in_the_way() -> None:
    around = standing((0.1, 0.3))
    assert len(way(LEFT, RIGHT, around, ())) == 3
    assert len(way(LEFT, RIGHT, around, around.root.tolist())) == 1


def walled(task: PickPlace, spec: mujoco.MjSpec, robot: object, *, props: Callable = PickPlace.add_props) -> None:
    props(task, spec, robot)
    wall = spec.worldbody.add_body(pos=[0.0, 0.0, TABLE_HEIGHT_M + WALL_M])
    wall.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.01, WALL_M])


def test_a_cube_is_carried_over_a_wall(
    shown: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = read_sources(open_dataset(shown("pick_place")))
    monkeypatch.setattr(PickPlace, "add_props", walled)
    beside = (np.array([-0.1, 0.2]), np.array([0.1, -0.2]))
    monkeypatch.setattr(pick_place, "two_places", lambda *_, **__: beside)
    with closing(aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=4)) as env:
        over = collect(env, Generator(sources), range(4), tmp_path / "over", progress=False)
        monkeypatch.setattr(generator, "way", lambda start, goal, *_: [goal])
        straight = collect(env, Generator(sources), range(4), tmp_path / "straight", progress=False)
    assert len(over.demos) == 4
    assert len(straight.demos) < 4

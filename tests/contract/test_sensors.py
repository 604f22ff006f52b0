"""Every registered sensor, and every field that anything shows: documented, of the size it says, the same twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.core import registry
from aerial_il.core.specs import EnvSpec, Field
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import CELLS, SAMPLE, batch

MARGIN, UNTOUCHED = 16, 123.25
each_sensor = pytest.mark.parametrize("name", registry.names("sensor"))


def carrier(name: str) -> Robot:
    """A robot with the sensor."""
    return next(robots.get(each) for each in robots.names() if name in robots.get(each).sensors)


def worlds_with(name: str) -> BatchEnvironment:
    """Worlds in which it is at work, under way."""
    task = next(task for robot, task in CELLS if robot == carrier(name).name)
    worlds = batch(carrier(name).name, task, "gusts")
    worlds.reset(3)
    for _ in range(3):
        worlds.step(0.5 * (worlds.spec.action.low + worlds.spec.action.high)[None].repeat(3, axis=0))
    return worlds


def check_documented(field: Field) -> None:
    assert field.meaning, f"{field.name}: what is it?"
    assert field.noise or field.group == "image", f"{field.name}: how does it differ from the truth?"
    assert field.frame or field.size != 3, f"{field.name}: in which frame are its x, y and z?"
    angular = any(word in field.meaning for word in ("axis", "direction", "matrix", "rotation", "vector"))
    unitless = field.unit == "" and (angular or field.labels or field.group == "image" or field.shape == (6,))
    assert field.unit or unitless, f"{field.name}: of which unit?"


@each_sensor
def test_its_fields_are_documented(name: str) -> None:
    robot = carrier(name)
    fields = registry.get("sensor", name)(**robot.sensors[name]).fields(robot)
    assert fields or name in ("gripper", "arm", "base")
    for field in fields:
        assert field.group == "proprio"
        assert len(field.shape) == 1
        check_documented(field)


@each_sensor
def test_it_writes_its_fields_and_nothing_else(name: str) -> None:
    robot, worlds = carrier(name), worlds_with(name)
    sensor, view = registry.get("sensor", name)(**robot.sensors[name]), worlds.simulation.view
    size = sum(field.size for field in sensor.fields(robot))
    if not size:
        return
    own, world = sensor.record(name, robot).view(np.recarray)[0], view.records.view(np.recarray)[0]
    seen = worlds.simulation.seen.records.view(np.recarray)[0]
    rows, compiled = [], registry.kernel("sensor", name, "read")
    for read in (compiled.py_func, compiled, compiled):
        whole = np.full(size + 2 * MARGIN, UNTOUCHED)
        row = whole[MARGIN : MARGIN + size]
        row[:] = np.nan
        read(own, world, seen, row)
        assert np.isfinite(row).all(), f"{name} leaves numbers of its fields unwritten"
        assert (whole[:MARGIN] == UNTOUCHED).all()
        assert (whole[-MARGIN:] == UNTOUCHED).all(), f"{name} writes beyond its fields"
        rows.append(row)
    np.testing.assert_allclose(rows[0], rows[1], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(rows[1], rows[2])


@each_sensor
def test_what_it_reads_is_what_is_observed(name: str) -> None:
    worlds, robot = worlds_with(name), carrier(name)
    once, again = worlds.observe(), worlds.observe()
    for field in registry.get("sensor", name)(**robot.sensors[name]).fields(robot):
        assert once[field.name].shape == (3, *field.shape)
    for field, value in once.items():
        np.testing.assert_array_equal(value, again[field], err_msg="a look changes nothing")


@pytest.mark.parametrize("task", tasks.names())
def test_the_fields_of_a_task_are_documented(task: str) -> None:
    result = tasks.get(task)
    for field in result.fields():
        check_documented(field)
    assert {f.name for f in result.fields() if not f.real} == {name for name, _ in result.privileged}
    assert all(len(reason.split()) >= 3 for _, reason in result.privileged)
    assert set(result.commanded) <= {*result.names.sites, *result.names.mocaps}


@pytest.mark.parametrize(("robot", "task"), SAMPLE)
def test_a_specification_keeps_what_fields_mean(robot: str, task: str) -> None:
    spec = Scenario(robot, task, cameras=("scene", "scene:depth")).spec
    names = [field.name for field in spec.observation.fields]
    assert len(set(names)) == len(names)
    for field in spec.observation.fields:
        check_documented(field)
        assert EnvSpec.from_dict(spec.to_dict()).observation[field.name].meaning == field.meaning
    first, *rest = spec.observation.fields
    renamed = replace(spec.observation, fields=(replace(first, meaning="said otherwise"), *rest))
    assert spec.differences(replace(spec, observation=renamed)) == []

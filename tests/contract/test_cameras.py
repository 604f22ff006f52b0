"""Every robot's cameras: names of their own, images of the size that is said, and something to see."""

from __future__ import annotations

import pytest

import aerial_il
from aerial_il import robots
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.robots.parts.camera import Camera
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import CELLS

each_robot = pytest.mark.parametrize("robot", robots.names())


def task_of(robot: str) -> str:
    return next(task for name, task in CELLS if name == robot)


@each_robot
def test_a_camera_is_an_observation_of_its_size(robot: str) -> None:
    names = [camera.name for camera in robots.get(robot).mounted_cameras]
    assert len(set(names)) == len(names)
    scenario = Scenario(robot, task_of(robot), cameras=names, image_size=(48, 64))
    assert scenario.camera_names == ("scene", *names)
    for camera in robots.get(robot).mounted_cameras:
        assert scenario.spec.observation[f"{camera.name}_rgb"].shape == (*(camera.size or (48, 64)), 3)
    with pytest.raises(UnknownNameError, match=names[0]):
        Scenario(robot, task_of(robot), cameras=("no_such_camera",))


@pytest.mark.render
@each_robot
def test_each_sees_something_of_its_own(robot: str) -> None:
    names = [camera.name for camera in robots.get(robot).mounted_cameras]
    worlds = aerial_il.load_batch(robot, task_of(robot), num_envs=1, cameras=names, image_size=(48, 64))
    obs = worlds.reset(3)
    images = [obs[f"{name}_rgb"][0] for name in names]
    worlds.close()
    assert all(image.std() > 1.0 for image in images)
    assert all((a.shape != b.shape) or (a != b).any() for i, a in enumerate(images) for b in images[:i])


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"name": "scene"}, "a name of its own"),
        ({"on": "wing"}, "on 'wing'; it can be on 'base' or on 'tool'"),
        ({"fov": 180.0}, "fov of 180.0 degrees; it lies between 0 and 180"),
        ({"forward": (0.0, 0.0, 1.0)}, "which is its up"),
        ({"size": (0, 10)}, r"up to \(960, 1280\), got \(0, 10\)"),
    ],
)
def test_an_impossible_camera_is_refused(changed: dict[str, object], said: str) -> None:
    good = {"name": "left", "on": "base", "pos": (0.0, 0.0, 0.0), "forward": (1.0, 0.0, 0.0)}
    assert Camera(**good).size is None  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match=said):
        Camera(**{**good, **changed})  # type: ignore[arg-type]

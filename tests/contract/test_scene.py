"""Every scene names its elements, and every camera sees what it is there for, in the size that is said."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.robots.parts.camera import Camera
from aerial_il.suite.environment import AerialEnvironment
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import CELLS, drawn, each_cell, each_of, single

each_cell_with_gripper = each_of([cell for cell in CELLS if robots.get(cell[0]).has_gripper])
SIZE = (240, 320)  # height and width, the default of a picture; a second size would cost as much as all pictures
ELEMENTS = ("body", "geom", "jnt", "site", "cam", "light", "actuator", "sensor", "tendon", "eq", "mat", "tex")


@each_cell
def test_every_element_has_a_name(robot: str, task: str) -> None:
    model = single(robot, task).physics.model.ptr
    for element in ELEMENTS:
        kind = {"jnt": "joint", "cam": "camera", "eq": "equality", "mat": "material", "tex": "texture"}.get(
            element, element
        )
        for i in range(getattr(model, f"n{element if element != 'actuator' else 'u'}")):
            name = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i)
            assert name, f"{kind} {i} has no name"


@each_cell
def test_the_stored_scene_compiles_to_the_same_model(robot: str, task: str) -> None:
    env = single(robot, task)
    ours, again = env.physics.model.ptr, mujoco.MjModel.from_xml_string(env.model_xml)
    for field in ("body_mass", "body_inertia", "geom_size", "jnt_range", "actuator_gear", "actuator_dynprm", "cam_pos"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(again, field), err_msg=field)


@each_cell
def test_cameras_are_those_of_the_model(robot: str, task: str) -> None:
    env = single(robot, task)
    model = env.physics.model.ptr
    assert len(env.camera_names) >= 2
    assert set(env.camera_names) == {model.camera(i).name for i in range(model.ncam)}


@pytest.fixture
def env(robot: str, task: str) -> AerialEnvironment:
    return drawn(robot, task)


def seen_bodies(env: AerialEnvironment, geoms: np.ndarray) -> dict[str, int]:
    """Pixels of each body in a picture of geom numbers (H, W)."""
    model = env.physics.model.ptr
    bodies = model.geom_bodyid[geoms[geoms >= 0]]
    return {model.body(i).name: int((bodies == i).sum()) for i in np.unique(bodies)}


def props(env: AerialEnvironment) -> set[str]:
    """Bodies of the task: neither the world's nor the robot's."""
    model = env.physics.model.ptr
    names = [model.body(i).name for i in range(1, model.nbody) if model.body_rootid[i] != model.body("base").id]
    return set(names)


@pytest.mark.render
@each_cell
def test_the_scene_camera_frames_robot_and_props(env: AerialEnvironment, robot: str, task: str) -> None:
    for seed in range(6):
        env.reset(seed=seed)
        geoms = env.render("scene", *SIZE, "segmentation")
        seen = seen_bodies(env, geoms)
        assert props(env) <= set(seen), f"seed {seed}: {props(env) - set(seen)} out of sight"
        assert sum(seen[body] for body in set(seen) - props(env) - {"world"}) > 120, "the robot is too small to be seen"
        assert {"finger_left", "finger_right"} & set(seen) or not robots.get(robot).has_gripper
        model = env.physics.model.ptr
        roots = {model.body(model.body_rootid[model.geom_bodyid[g]]).name for g in _border(geoms) if g >= 0}
        assert "base" not in roots, f"seed {seed}: the robot is cut off"


def _border(image: np.ndarray) -> np.ndarray:
    return np.unique(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]))


@pytest.mark.render
@each_cell_with_gripper
def test_the_wrist_camera_sees_both_fingers_and_the_tool_point(env: AerialEnvironment, robot: str, task: str) -> None:
    env.reset(seed=0)
    seen = seen_bodies(env, env.render("wrist", *SIZE, "segmentation"))
    assert min(seen["finger_left"], seen["finger_right"]) > 80
    assert seen["finger_left"] == pytest.approx(seen["finger_right"], rel=0.2)
    depth, (row, column) = env.render("wrist", *SIZE, "depth"), _project(env, "wrist", "tool")
    camera = env.physics.data.ptr.camera("wrist")
    towards_tool = (env.physics.data.ptr.site("tool").xpos - camera.xpos) @ -camera.xmat.reshape(3, 3)[:, 2]
    assert depth[row, column] > towards_tool, "something hides the tool point"


@pytest.mark.render
@each_cell_with_gripper
def test_the_base_camera_sees_the_gripper_and_what_is_below(env: AerialEnvironment, robot: str, task: str) -> None:
    env.reset(seed=0)
    seen = seen_bodies(env, env.render("base", *SIZE, "segmentation"))
    assert seen.get("palm", 0) + seen.get("finger_left", 0) + seen.get("finger_right", 0) > 80
    assert seen["world"] > 0.5 * SIZE[0] * SIZE[1], "the robot blocks its own view"


def _project(env: AerialEnvironment, camera: str, site: str) -> tuple[int, int]:
    """Pixel (row, column) of a site in a picture of ``SIZE``."""
    data, model = env.physics.data.ptr, env.physics.model.ptr
    local = data.camera(camera).xmat.reshape(3, 3).T @ (data.site(site).xpos - data.camera(camera).xpos)
    focal = 0.5 * SIZE[0] / np.tan(0.5 * np.deg2rad(model.cam_fovy[model.camera(camera).id]))
    across, down = local[0] / local[2], local[1] / local[2]
    return round(0.5 * SIZE[0] + focal * down), round(0.5 * SIZE[1] - focal * across)


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

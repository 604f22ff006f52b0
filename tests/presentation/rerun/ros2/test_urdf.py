"""The URDF of a robot moves as MuJoCo's model does, judged by the specification and by MuJoCo's own reader of URDF."""

from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.presentation.rerun.motion import robot_bodies
from aerial_il.presentation.rerun.ros2.kinematics import WORLD, tree_of
from aerial_il.presentation.rerun.ros2.urdf import urdf_of
from tests.presentation.rerun.ros2.forward import poses

ODD = """
<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .1  .1 .1 0"/></asset>
  <worldbody>
    <body name="base" pos="1 2 3" euler="20 30 40">
      <freejoint/>
      <geom type="ellipsoid" size=".2 .1 .05"/>
      <body name="two" pos=".1 .2 0" euler="0 90 0">
        <joint name="turn" axis="0 1 1" pos="0 .1 0" ref="30" range="-90 90" limited="true"/>
        <joint name="slide" type="slide" axis="1 0 1" pos=".3 0 0" ref=".05" range="-.1 .2" limited="true"/>
        <geom type="mesh" mesh="wedge"/>
        <body pos="0 0 .1">
          <joint name="endless" axis="1 0 0"/>
          <geom type="capsule" size=".01 .1"/>
          <body name="tip" pos=".1 0 0"><geom size=".01"/></body>
        </body>
      </body>
    </body>
    <body name="table"><geom type="box" size="1 1 .1"/></body>
  </worldbody>
</mujoco>
"""

AS_IT_IS = '<mujoco><compiler fusestatic="false" discardvisual="false" boundmass="1e-9" boundinertia="1e-12"/></mujoco>'


def model_of(robot: str) -> mujoco.MjModel:
    if robot == "odd":
        return mujoco.MjModel.from_xml_string(ODD)
    task = "hover" if robot == "quad" else "reach"
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1)
    try:
        return mujoco.MjModel.from_xml_string(env.model_xml)
    finally:
        env.close()


@pytest.fixture(scope="module", params=[*robots.names(), "odd"])
def model(request: pytest.FixtureRequest) -> mujoco.MjModel:
    return model_of(request.param)


def placed(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    """Return the model with joints anywhere in their ranges, its base anywhere."""
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    for joint in range(model.njnt):
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-2.0, 2.0)
        if int(model.jnt_type[joint]) in (2, 3):
            data.qpos[model.jnt_qposadr[joint]] = rng.uniform(low, high)
        elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            data.qpos[model.jnt_qposadr[joint] :][:7] = rng.normal(size=7)
    mujoco.mj_forward(model, data)
    return data


def relative(data: mujoco.MjData, root: int, body: int) -> np.ndarray:
    """Return a body's pose (4, 4) in another body."""
    matrices = []
    for number in (root, body):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = data.xmat[number].reshape(3, 3), data.xpos[number]
        matrices.append(matrix)
    return np.linalg.inv(matrices[0]) @ matrices[1]


def joint_values(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, float]:
    return {joint.name: float(data.qpos[model.jnt_qposadr[joint.index]]) for joint in tree_of(model).moving}


@pytest.mark.parametrize("seed", [0, 1])
def test_forward_kinematics_are_mujoco_s(model: mujoco.MjModel, seed: int) -> None:
    data, tree = placed(model, seed), tree_of(model)
    result = poses(urdf_of(model, tree, "robot"), joint_values(model, data))
    root = tree.bodies[tree.root]
    assert len(tree.bodies) == robot_bodies(model).sum()
    for link, body in tree.bodies.items():
        np.testing.assert_allclose(result[link], relative(data, root, body), atol=1e-7, err_msg=link)


def test_mujoco_reads_the_same_robot_back(model: mujoco.MjModel) -> None:
    data, tree = placed(model, 2), tree_of(model)
    text = urdf_of(model, tree, "robot").replace("</robot>", f"{AS_IT_IS}</robot>")
    again = mujoco.MjModel.from_xml_string(text)
    moved = mujoco.MjData(again)
    for name, value in joint_values(model, data).items():
        moved.qpos[again.jnt_qposadr[again.joint(name).id]] = value
        joint, same = again.joint(name), model.joint(name)
        assert joint.limited == same.limited, name
        np.testing.assert_allclose(joint.range, same.range, atol=1e-9)
    mujoco.mj_forward(again, moved)
    root = tree.bodies[tree.root]
    for link, body in tree.bodies.items():
        if body != root:  # MuJoCo welds the root to the world, and calls it that
            seen = relative(moved, 0, again.body(link).id)
            np.testing.assert_allclose(seen, relative(data, root, body), atol=1e-7, err_msg=link)
            assert again.body(link).mass == pytest.approx(model.body_mass[body])
            np.testing.assert_allclose(_inertia(again, again.body(link).id), _inertia(model, body), atol=1e-9)


def _inertia(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Return a body's inertia (3, 3) in its own axes."""
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, model.body_iquat[body])
    axes = mat.reshape(3, 3)
    return axes @ np.diag(model.body_inertia[body]) @ axes.T


def test_what_urdf_cannot_say_is_said_by_what_it_can() -> None:
    model = model_of("odd")
    robot = ET.fromstring(urdf_of(model, tree_of(model), "odd").encode())
    looks = {link.get("name"): [g[0].tag for g in link.iterfind("visual/geometry")] for link in robot.iter("link")}
    assert looks["base"] == ["cylinder"] * 7
    assert looks["two"] == ["box"]
    assert looks["body_3"] == ["cylinder", "sphere", "sphere"]
    assert "table" not in looks
    kinds = {joint.get("name"): joint.get("type") for joint in robot.iter("joint")}
    assert kinds == {
        "turn": "revolute", "slide": "prismatic", "two_fixed": "fixed", "endless": "continuous", "tip_fixed": "fixed",
    }  # fmt: skip


def test_the_discs_of_an_ellipsoid_have_its_volume() -> None:
    model = model_of("odd")
    base = ET.fromstring(urdf_of(model, tree_of(model), "odd").encode()).find("link[@name='base']")
    assert base is not None
    discs = [{key: float(value) for key, value in disc.items()} for disc in base.iterfind("visual/geometry/cylinder")]
    volume = sum(np.pi * disc["radius"] ** 2 * disc["length"] for disc in discs)
    assert volume == pytest.approx(4 / 3 * np.pi * 0.2 * 0.1 * 0.05)


def test_a_robot_that_is_held_by_joints_begins_at_the_world() -> None:
    from tests.data.crane import crane_model

    tree = tree_of(crane_model())
    assert tree.root == WORLD
    assert [joint.kind for joint in tree.joints] == ["prismatic", "prismatic", "continuous"]
    text = urdf_of(crane_model(), tree, "crane")
    result = poses(text, {"x": 0.5, "z": 1.0, "swing": np.pi / 2})
    np.testing.assert_allclose(result["hook"][:3, 3], [0.5, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(result["hook"][:3, 2], [1.0, 0.0, 0.0], atol=1e-12)

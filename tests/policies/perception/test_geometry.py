"""What a camera is taken to see is what it sees, and what follows from places is found in the data."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.policies.perception.cameras import Camera, Pose
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.relations import find_rates, find_sums
from aerial_il.policies.perception.targets import FARTHEST, Target, Targets

ROBOTS = ("fa_hexa_arm4", "ua_quad_arm4", "floating_gripper", "mini_quad_gripper")


@pytest.mark.render
@pytest.mark.parametrize("robot", ROBOTS)
def test_camera_is_where_the_simulator_has_it(robot):
    with closing(
        aerial_il.load_batch(robot, "reach", num_envs=2, cameras=("wrist", "base"), image_size=(48, 64))
    ) as env:
        obs = env.reset(7)
        for _ in range(20):
            obs = env.step(env.spec.action.clip(np.full((2, env.spec.action.size), 0.3))).obs
        for image in ("wrist_rgb", "base_rgb"):
            camera = Camera.of(env.spec, image)
            pose, shot = camera.pose(obs), env.data(1).cam(image.removesuffix("_rgb"))
            np.testing.assert_allclose(pose.pos[1], shot.xpos, atol=1e-6)
            np.testing.assert_allclose(pose.rot[1].ravel(), shot.xmat, atol=1e-5)
            assert camera.slope == pytest.approx(np.tan(np.deg2rad(0.5 * env.model.cam(shot.id).fovy[0])))
            assert camera.aspect == pytest.approx(64 / 48)


@pytest.mark.render
def test_place_is_where_the_picture_shows_it():
    with closing(
        aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=1, cameras=("base",), image_size=(120, 160))
    ) as env:
        obs, camera = env.reset(3), Camera.of(env.spec, "base_rgb")
        ids = env.render(camera="base", height=120, width=160, modality="segmentation")
        own = camera.pose(obs).seen(obs["cube_pos"])
        across, up, log_depth = camera.project(own)[0]
        rows, columns = np.nonzero(ids == env.model.geom("cube").id)
        assert camera.in_view(own)[0]
        assert rows.mean() == pytest.approx(60 * (1 - up), abs=2)
        assert columns.mean() == pytest.approx(80 * (1 + across), abs=2)
        depth = env.render(camera="base", height=120, width=160, modality="depth")[ids == env.model.geom("cube").id]
        assert depth.mean() == pytest.approx(np.exp(log_depth), abs=0.04)


def test_projection_is_undone_and_its_spread_is_that_of_samples():
    camera = Camera("wrist_rgb", "tool", np.eye(3), np.zeros(3), slope=0.8, aspect=1.5)
    rng = np.random.default_rng(0)
    image = np.column_stack([rng.uniform(-1, 1, (5, 2)), rng.uniform(-1.5, 0.5, 5)])
    own = camera.unproject(image)
    np.testing.assert_allclose(camera.project(own), image, atol=1e-12)
    rot = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    pose = Pose(np.tile(rot, (5, 1, 1)), rng.standard_normal((5, 3)))
    np.testing.assert_allclose(pose.seen(pose.placed(own)), own, atol=1e-12)
    sigma = np.array([[0.02, 0.03, 0.05]])
    drawn = image[:1] + sigma * rng.standard_normal((200_000, 3))
    samples = camera.unproject(drawn) * (1.0, 1.0, -1.0)  # in the axes of the image
    np.testing.assert_allclose(camera.spread(image[:1], sigma)[0], np.cov(samples.T), rtol=0.05, atol=2e-6)


def test_camera_that_nobody_knows_is_refused():
    env = aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=1, cameras=("scene",))
    env.close()
    with pytest.raises(InvalidValueError, match=r"not taken by a camera that fa_hexa_arm4 carries \(wrist, base\)"):
        Camera.of(env.spec, "scene_rgb")
    with pytest.raises(InvalidValueError, match="aerial-il new robot"):
        Camera.of(replace(env.spec, robot="somebody's"), "scene_rgb")


SPEC = ObservationSpec(
    (
        Field("ee_pos", (3,), unit="m", frame="world"),
        Field("ee_rot6d", (6,), frame="world from tool"),
        Field("a_pos", (3,), "task", unit="m", frame="world"),
        Field("axis", (3,), "task", frame="world"),
        Field("tool_to_a", (3,), "task", unit="m", frame="world"),
        Field("end", (3,), "task", unit="m", frame="world"),
        Field("b_to_a", (3,), "task", unit="m", frame="world"),
        Field("told", (2,), "task", onboard=True),
    )
)


def flight(rng: np.random.Generator, steps: int = 50) -> dict[str, np.ndarray]:
    obs = {f.name: rng.standard_normal((steps, f.size)) for f in SPEC.fields}
    obs["tool_to_a"] = obs["a_pos"] - obs["ee_pos"]
    obs["end"] = obs["a_pos"] + 0.04 * obs["axis"]
    return obs


def test_sums_are_found_and_others_are_not():
    obs = flight(np.random.default_rng(1))
    found = {each.field: dict(each.terms) for each in find_sums(SPEC, obs)}
    assert found == {"tool_to_a": {"a_pos": 1.0, "ee_pos": -1.0}, "end": {"a_pos": 1.0, "axis": pytest.approx(0.04)}}
    obs["tool_to_a"][7] += 0.2  # one step in which it does not hold
    assert [each.field for each in find_sums(SPEC, obs)] == ["end"]
    obs["b_to_a"] = np.full_like(obs["b_to_a"], 1e-5)
    assert [each.field for each in find_sums(SPEC, obs)] == ["end"], "what never left zero is a sum of nothing"


TURNING = ObservationSpec(
    (
        Field("ee_pos", (3,), unit="m", frame="world"),
        Field("door_angle", (1,), "task", unit="rad"),
        Field("valve_angle", (1,), "task", unit="rad"),
        Field("door_rate", (1,), "task", unit="rad/s"),
        Field("wheel_rate", (1,), "task", unit="rad/s"),
    )
)


def test_rates_are_found_and_others_are_not():
    """Units alone make no rate: the wheel turns by itself, and neither angle tells how fast."""
    rng = np.random.default_rng(3)
    times = np.arange(80)[:, None]
    flights = [{f.name: rng.standard_normal((80, f.size)) for f in TURNING.fields} for _ in range(3)]
    for number, each in enumerate(flights):
        each["door_angle"] = np.sin(0.05 * times + number)
        each["door_rate"] = 0.05 * 50.0 * np.cos(0.05 * times + number)
    found = find_rates(TURNING, flights, TURNING.to_be_seen)
    assert [(each.field, each.of) for each in found] == [("door_rate", "door_angle")]
    assert found[0].factor == pytest.approx(50.0, rel=0.01)
    targets = Targets.of(TURNING, flights, ("ee_pos", "door_rate", "wheel_rate"))
    assert [each.field for each in targets.estimated] == ["door_angle", "wheel_rate"], (
        "the angle, as its rate is wanted"
    )
    assert Targets.from_dict(targets.to_dict()).to_dict() == targets.to_dict()


def test_what_no_demonstration_comes_near_is_told_as_far():
    """A crash presses a thousand times as hard as any demonstration: it must not be all that is learned from it."""
    camera = Camera("wrist_rgb", "tool", np.eye(3), np.zeros(3), slope=0.8, aspect=1.5)
    pose = Pose(np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)))
    force = Target("force", "number", 1, 1, np.ones(1), np.full(1, 0.5), np.zeros(1), ("force",))
    told = force.encode(np.array([[1.0], [2.0], [500.0]]), pose, camera)
    np.testing.assert_allclose(told[:, 0], [0.0, 2.0, FARTHEST])
    np.testing.assert_allclose(force.decode(told, pose)[:2, 0], [1.0, 2.0])


def test_what_a_robot_knows_by_itself_is_not_estimated():
    targets = Targets.of(SPEC, [flight(np.random.default_rng(2))], SPEC.state_names)
    assert [(each.field, each.kind) for each in targets.estimated] == [
        ("a_pos", "place"), ("axis", "rotation"), ("b_to_a", "number"),
    ]  # fmt: skip
    assert SPEC["told"].is_onboard
    assert "told" not in SPEC.to_be_seen
    few = Targets.of(SPEC, [flight(np.random.default_rng(2))], ("ee_pos", "tool_to_a"))
    assert [each.field for each in few.estimated] == ["a_pos"], "no more than the policy needs"
    assert Targets.from_dict(targets.to_dict()).to_dict() == targets.to_dict()


@pytest.mark.parametrize("task", aerial_il.list_tasks())
def test_every_task_says_what_is_to_be_seen(task):
    """No rule for a task: its own fields decide, and nothing that shows an object counts as the robot's own."""
    robot = next(robot for robot, each in aerial_il.list_cells() if each == task)
    with closing(aerial_il.load_batch(robot, task, num_envs=1)) as env:
        spec = env.spec.observation
    own = [f for f in spec.of_group("task") if f.is_onboard]
    assert {f.name for f in own} <= {"wrist_force", "tool_force", "thrust_share", "perched_s"}
    points = ((3,), "m", "world")
    vectors = {name for name in spec.to_be_seen if (spec[name].shape, spec[name].unit, spec[name].frame) == points}
    named = {name for name in vectors if name.endswith("_pos") or "_to_" in name}
    assert vectors - named <= {"slip"}, "a place that is not called so is not looked for in images"
    assert spec.to_be_seen


def test_mujoco_looks_along_its_own_minus_z():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><camera name='c' pos='0 0 1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pose = Pose(data.cam("c").xmat.reshape(1, 3, 3), data.cam("c").xpos[None])
    np.testing.assert_allclose(pose.seen(np.array([[0.1, 0.2, 0.4]])), [[0.1, 0.2, 0.6]])


ORBIT = ObservationSpec(
    (
        Field("ee_pos", (3,), unit="m", frame="world"),
        Field("ee_rot6d", (6,), frame="world from tool"),
        Field("ball_pos", (3,), "task", unit="m", frame="world"),
        Field("ball_vel", (3,), "task", unit="m/s", frame="world"),
        Field("tool_to_soon", (6,), "task", unit="m", frame="world"),
        Field("pair", (2,), "task", unit="m", frame="world"),
    )
)


def test_where_something_will_be_follows_from_where_it_is_and_how_fast_it_moves():
    """Two points in one field are two sums, near but not exact; the policy is shown both, and asks for no image."""
    rng, flights = np.random.default_rng(4), list[dict[str, np.ndarray]]()
    for _ in range(4):
        phase, tool = 0.02 * np.arange(250)[:, None] + rng.uniform(0, 6, 3), 0.1 * rng.standard_normal((250, 3))
        at = [0.3 * np.sin(phase + 0.02 * steps) for steps in (0, 10, 25)]
        soon = np.concatenate([at[1] - tool, at[2] - tool], axis=1)
        flights.append(
            {
                "ee_pos": tool,
                "ee_rot6d": rng.standard_normal((250, 6)),
                "ball_pos": at[0],
                "ball_vel": 0.3 * np.cos(phase),
                "tool_to_soon": soon,
                "pair": tool[:, :2],
            }
        )
    found = Targets.of(ORBIT, flights, ("tool_to_soon", "pair"))
    assert [each.field for each in found.sums] == ["tool_to_soon"] * 2
    assert [each.field for each in found.estimated] == ["ball_pos", "pair"], "two numbers are no points"
    assert [each.field for each in found.rates] == ["ball_vel"], "the sums need it, the policy does not"
    for each, ahead in zip(found.sums, (0.2, 0.5), strict=True):
        assert dict(each.terms) == pytest.approx({"ee_pos": -1.0, "ball_pos": 1.0, "ball_vel": ahead}, abs=0.15)
    again = Targets.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.sums == found.sums
    assert not Targets.of(ORBIT, flights, ("pair",)).sums


RAIL = ObservationSpec(
    (
        Field("ee_pos", (3,), unit="m", frame="world"),
        Field("ee_rot6d", (6,), frame="world from tool"),
        Field("handle_pos", (3,), "task", unit="m", frame="world"),
        Field("handle_to_end", (3,), "task", unit="m", frame="world"),
    )
)


@pytest.mark.parametrize("rests", [True, False])
def test_where_a_displacement_ends_is_looked_for_if_it_rests(rests):
    """No camera sees a displacement: the end of a rail is a place, and how far the handle is from it follows."""
    rng, flights, ends = np.random.default_rng(5), list[dict[str, np.ndarray]](), list[np.ndarray]()
    for _ in range(4):
        end = rng.standard_normal(3) + (0.0 if rests else 0.1 * rng.standard_normal((60, 1)))
        handle = rng.standard_normal(3) + np.linspace(0.0, 0.3, 60)[:, None] * rng.standard_normal(3)
        pose = {"ee_pos": rng.standard_normal((60, 3)), "ee_rot6d": rng.standard_normal((60, 6))}
        flights.append({**pose, "handle_pos": handle, "handle_to_end": end - handle})
        ends.append(np.broadcast_to(end, (60, 3)))
    found = Targets.of(RAIL, flights, ("handle_to_end",))
    names = ["handle_pos", "end of handle_to_end"] if rests else ["handle_to_end"]
    assert [each.field for each in found.estimated] == names
    if rests:
        looked = found.estimated[1]
        np.testing.assert_allclose(looked.values(flights[0]), ends[0])
        told = {"handle_pos": flights[0]["handle_pos"], looked.field: ends[0]}
        again = Targets.from_dict(json.loads(json.dumps(found.to_dict())))
        complete = Eyes(again, (), (), (), 0, 8).complete(flights[0], told)
        np.testing.assert_allclose(complete["handle_to_end"], flights[0]["handle_to_end"])

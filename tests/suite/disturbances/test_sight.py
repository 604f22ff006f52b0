"""What disturbs cameras alone: no bit of a flight changes, and images change as it says, by seed."""

from __future__ import annotations

from colorsys import rgb_to_hsv
from contextlib import closing
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.cameras import CameraRequest
from aerial_il.suite.disturbances.lens import blurred
from aerial_il.suite.disturbances.looks import HUE_DEG, LIGHT
from aerial_il.suite.disturbances.nominal import LIGHTS, SHAPES
from aerial_il.suite.rendering import ROUNDNESS, FrameRenderer, Renderer, Sight, View
from tests.contract.registered import random_actions

ROBOT, TASK, SEEDS = "fa_hexa_arm4", "pick_place", np.array([3, 4])
SEEN = ("camera_shift", "camera_tilt", "lens", "looks")
CAMERAS = ("wrist@32x32", "base@32x32", "base:depth@32x32", "base:segmentation@32x32", "scene@32x32")
each_seen = pytest.mark.parametrize("name", SEEN)
CELLS = [("quad", "land"), (ROBOT, TASK), (ROBOT, "toss_ball"), ("big_four_z1", "carry_slung_load")]
each_cell = pytest.mark.parametrize(("robot", "task"), CELLS)


def load(tier: str, num_envs: int = 2) -> BatchEnvironment:
    return aerial_il.load_batch(ROBOT, TASK, num_envs=num_envs, num_threads=1, tier=tier, cameras=CAMERAS)


def flown(tier: str, seeds: np.ndarray = SEEDS, steps: int = 4) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What is seen in the end of a short flight, and the state then."""
    env = load(tier, len(seeds))
    try:
        obs = env.reset(seeds)
        for action in random_actions(env.spec.action, steps, 1):
            obs = env.step(np.tile(action, (len(seeds), 1))).obs
        return obs, env.get_state()
    finally:
        env.close()


@pytest.mark.render
@each_seen
def test_a_flight_is_the_same_bit_for_bit_and_looks_otherwise(name: str) -> None:
    calm, state = flown("calm")
    seen, same = flown(f"calm+{name}")
    np.testing.assert_array_equal(same, state)
    assert all((seen[key] != calm[key]).any() for key in ("wrist_rgb", "base_rgb"))
    for key in calm.keys() - {"wrist_rgb", "base_rgb", "scene_rgb", "base_depth", "base_segmentation"}:
        np.testing.assert_array_equal(seen[key], calm[key])
    assert (seen["scene_rgb"] != calm["scene_rgb"]).any() == (name == "looks"), "the scene's camera is not the robot's"
    assert tiers.get(f"calm+{name}").parts[name].seen_alone


def test_what_changes_a_flight_would_be_noticed() -> None:
    assert (flown("calm+payload")[1] != flown("calm")[1]).any()
    assert not tiers.get("hard").parts["payload"].seen_alone


@pytest.mark.render
@each_seen
def test_images_depend_on_the_seed_and_not_on_company(name: str) -> None:
    together, _ = flown(f"calm+{name}")
    for world, seed in enumerate(SEEDS):
        alone, _ = flown(f"calm+{name}", np.array([seed]))
        for key in ("wrist_rgb", "base_rgb", "base_depth", "scene_rgb"):
            np.testing.assert_array_equal(alone[key][0], together[key][world])


@pytest.mark.render
def test_a_moment_can_be_looked_at_as_in_other_episodes() -> None:
    """With what cameras alone notice: the load that is carried, and so the flight, stays that of the episode."""
    action, others = random_actions(load("calm").spec.action, 1, 1)[0], SEEDS + 50
    with closing(load("calm+looks+lens+payload")) as env:
        env.reset(SEEDS)
        env.step(np.tile(action, (2, 1)))
        state = env.get_state()
        own, other = env.set_state(state), env.set_state_in_looks(state, others)
        went_on = env.step(np.tile(action, (2, 1))).obs
        np.testing.assert_array_equal(env.set_state_in_looks(state, others)["base_rgb"], other["base_rgb"])
        back = env.set_state(state)
        as_ever = env.step(np.tile(action, (2, 1))).obs
    for key in own:
        np.testing.assert_array_equal(back[key], own[key])
        if key.endswith("_rgb"):
            assert (other[key] != own[key]).any()
        else:
            np.testing.assert_array_equal(other[key], own[key])
            np.testing.assert_array_equal(went_on[key], as_ever[key])
    with closing(load("calm")) as env:
        state = env.reset(SEEDS) and env.get_state()
        np.testing.assert_array_equal(
            env.set_state_in_looks(state, others)["base_rgb"], env.set_state(state)["base_rgb"]
        )


@pytest.mark.render
def test_one_world_sees_the_same_as_many() -> None:
    tier = "calm+camera_tilt+lens+looks"
    many, single = load(tier), aerial_il.load(ROBOT, TASK, tier=tier, cameras=CAMERAS)
    try:
        seen, alone = many.reset(SEEDS), single.reset(seed=int(SEEDS[0])).observation
        assert single.physics.model.ptr.geom_rgba.tolist() == many.model.geom_rgba.tolist(), "as it was"
    finally:
        many.close()
        single.close()
    for key in ("wrist_rgb", "base_rgb", "base_depth", "base_segmentation", "scene_rgb"):
        np.testing.assert_array_equal(seen[key][0], alone[key])


@pytest.mark.render
def test_a_lens_is_of_colour_images_and_its_noise_of_each() -> None:
    calm, _ = flown("calm")
    seen, _ = flown("calm+lens")
    for key in ("base_depth", "base_segmentation"):
        np.testing.assert_array_equal(seen[key], calm[key])
    env = load("calm+lens", 1)
    try:
        still = [env.reset(np.array([3]))["wrist_rgb"], env.observe()["wrist_rgb"]]
        np.testing.assert_array_equal(*still)
        later = env.step(env.spec.action.clip(np.zeros((1, env.spec.action.size)))).obs["wrist_rgb"]
        assert (later != still[0]).mean() > 0.5
    finally:
        env.close()


def test_blur_keeps_the_brightness_and_spreads_a_point_as_far_as_it_says() -> None:
    image = np.zeros((21, 21, 3), np.float32)
    image[10, 10] = 1.0
    spread = blurred(image, 1.5)
    assert spread.sum() == pytest.approx(3.0, rel=1e-5)
    rows = (np.arange(21) - 10.0)[:, None] ** 2
    assert np.sqrt((spread[..., 0] * rows).sum()) == pytest.approx(1.5, rel=0.1)
    np.testing.assert_array_equal(blurred(image, 0.0), image)


@pytest.mark.parametrize("degrees", [0.0, 10.0])
def test_a_camera_is_turned_by_the_angle(degrees: float) -> None:
    env = aerial_il.load_batch(ROBOT, TASK, num_envs=1, num_threads=1, tier=f"calm+camera_tilt:{degrees:g}")
    env.reset(3)
    data = env.data(0)
    for name in ("wrist", "base", "scene"):
        camera = env.model.camera(name).id
        before, place = data.cam_xmat[camera].reshape(3, 3).copy(), data.cam_xpos[camera].copy()
        env.simulation.sight(0).place(data, camera, name)
        after = data.cam_xmat[camera].reshape(3, 3)
        turned = np.degrees(np.arccos(np.clip(0.5 * (np.trace(before.T @ after) - 1.0), -1.0, 1.0)))
        assert turned == pytest.approx(0.0 if name == "scene" else degrees, abs=1e-4)
        np.testing.assert_array_equal(data.cam_xpos[camera], place)


@pytest.mark.parametrize("strength", [1, 2])
@each_cell
def test_looks_keep_hues_that_tasks_name_and_things_touch_nothing(robot: str, task: str, strength: int) -> None:
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1, tier=f"calm+looks:{strength}")
    model = env.model
    touching = (model.geom_contype | model.geom_conaffinity).astype(bool) & (model.geom_bodyid != 0)
    for seed in range(4):
        env.reset(seed)
        fields, data = env.simulation.sight(0).fields, env.data(0)
        for geom in range(model.ngeom):
            rgb, nominal = fields["geom_rgba"][geom, :3], model.geom_rgba[geom, :3]
            if model.geom_bodyid[geom] and not model.geom(geom).name.startswith("table"):
                (hue, saturation, _), (was, as_much, _) = rgb_to_hsv(*rgb), rgb_to_hsv(*nominal)
                if as_much > 0.05:
                    away = 360.0 * abs((hue - was + 0.5) % 1.0 - 0.5)
                    assert away <= strength * HUE_DEG + 1e-3
                assert saturation == pytest.approx(as_much, abs=1e-3)
        np.testing.assert_array_equal(fields["geom_rgba"][:, 3], model.geom_rgba[:, 3])
        walls = fields[SHAPES][:, 1] > 1.0
        things, away = fields[SHAPES][~walls], np.hypot(*fields[SHAPES][:, 4:6].T)
        gaps = np.linalg.norm(data.geom_xpos[touching, None] - things[:, 4:7], axis=2)
        assert (gaps > model.geom_rbound[touching, None] + np.linalg.norm(things[:, 1:4], axis=1)).all()
        assert (away[~walls] - np.linalg.norm(things[:, 1:3], axis=1) > 0.65).all(), "beside any table"
        reach = np.hypot(*data.geom_xpos[touching, :2].T) + model.geom_rbound[touching]
        assert (away[walls] - 0.05 > reach.max()).all()


def test_what_is_drawn_at_strength_2_is_never_drawn_at_1() -> None:
    amounts: dict[int, list[np.ndarray]] = {1: [], 2: []}
    for strength, found in amounts.items():
        env = aerial_il.load_batch(ROBOT, TASK, num_envs=20, num_threads=1, tier=f"calm+looks:{strength}")
        nominal = env.simulation.disturbances._nominal.field(LIGHTS)
        for world in range(20):
            lights = env.simulation.sight(world).fields[LIGHTS]
            found.append(np.abs(np.log(lights[:3] / nominal[:3])) / LIGHT)
    assert np.max(amounts[1]) <= 1.0 <= np.min(amounts[2])
    assert np.max(amounts[2]) <= 2.0
    assert np.max(amounts[1]) > 0.9


@each_seen
def test_a_robot_without_cameras_does_not_notice(name: str) -> None:
    part = tiers.standard(name)
    robot = robots.get(ROBOT)
    assert part.unfelt(robot) is None
    assert "has no cameras" in (part.unfelt(replace(robot, cameras=())) or "")


@pytest.mark.render
@each_cell
def test_what_is_not_drawn_is_out_of_sight(robot: str, task: str) -> None:
    """Pixels are those of MuJoCo's own renderer, which draws all."""
    env = aerial_il.load_batch(robot, task, num_envs=1, num_threads=1)
    renderer = FrameRenderer(env.model, 40, 60)
    model = env.scenario.compile()
    model.vis.quality.numslices, model.vis.quality.numstacks = ROUNDNESS
    everything = Renderer(model, 40, 60)
    try:
        hidden = 0
        for seed in range(2):
            env.reset(seed)
            data = env.data(0)
            for name in env.camera_names:
                image = renderer.shoot(data, CameraRequest(name, "rgb", (40, 60)), Sight())
                view = View.of(env.model, data, env.model.camera(name).id, 1.5)
                hidden += np.count_nonzero(~view.of_balls(data.geom_xpos, env.model.geom_rbound))
                everything.update_scene(data, camera=name)
                everything.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
                everything.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
                np.testing.assert_array_equal(image, everything.render())
        assert hidden
    finally:
        renderer.close()
        everything.close()
        env.close()

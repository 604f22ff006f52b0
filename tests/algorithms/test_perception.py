"""Seeing: trained on images, flown without the truth, gone on with after a kill, and refused where nothing is seen."""

from __future__ import annotations

import shutil
from contextlib import closing
from dataclasses import replace
from functools import partial
from time import perf_counter
from types import SimpleNamespace

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.perception import Perception
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.algorithms.seeing.frames import Frames, drawn
from aerial_il.algorithms.seeing.redrawing import HELD_M, Redrawing
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import attach
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.policies.mlp import MLP
from aerial_il.policies.perception.policy import PerceivingPolicy

pytestmark = pytest.mark.render
CAMERAS, IMAGES = ("wrist", "base"), ("wrist_rgb", "base_rgb")
POLICY = MLP(hidden=(32,), images=IMAGES)
SMALL = Perception(
    training=BC(steps=30, validation=0.0), steps=20, more_steps=10, batch_size=8, width=32, frames=40, redrawn=20,
    flown=20, rounds=1, episodes=2, validation=0.3,
)  # fmt: skip


def environment(task: str, worlds: int = 2):
    return aerial_il.load_batch("fa_hexa_arm4", task, num_envs=worlds, cameras=CAMERAS, image_size=(32, 32))


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Four demonstrations of a button that is pressed, with images."""
    place = tmp_path_factory.mktemp("seen") / "demos"
    with closing(environment("press_button")) as env:
        collect(env, aerial_il.expert("fa_hexa_arm4", "press_button"), range(4), place, progress=False)
    return place


def trained(shown, run, settings=SMALL) -> PerceivingPolicy:
    with closing(environment("press_button")) as env:
        return trained_on(open_dataset(shown, cameras=IMAGES), run, env, settings)


def trained_on(demos, run, env, settings=SMALL) -> PerceivingPolicy:
    policy = settings.train(demos, POLICY, run=run, env=env, collect=collect, progress=False)
    assert isinstance(policy, PerceivingPolicy)
    return policy


def test_flies_on_what_it_sees_and_repeats_itself_from_disk(shown, tmp_path):
    policy = trained(shown, tmp_path / "run")
    again = aerial_il.load_policy(tmp_path / "run")
    assert policy.observations == "onboard"
    rows = read_metrics(tmp_path / "run")
    assert [row["step"] for row in rows] == [0, 1]
    assert {"validation/button_pos", "validation/button_rot6d", "validation/button_travel"} <= {*rows[1]}
    assert rows[1]["flights"] == 2
    with closing(environment("press_button")) as env:
        for each in (policy, again):
            attach(each, env)
        obs = env.reset(50)
        for _ in range(6):
            action = policy.act(obs)
            np.testing.assert_array_equal(action, again.act(obs))
            obs = env.step(action).obs
        lied = {n: v + 1.0 if n in env.spec.observation.to_be_seen else v for n, v in obs.items()}
        policy.reset()
        again.reset()
        np.testing.assert_array_equal(policy.act(lied), again.act({**lied, "button_pos": lied["button_pos"] - 7.0}))


@pytest.mark.parametrize(
    ("steps", "flown"),
    [(SMALL.execute, (4, None)), (99, (POLICY.chunk, None)), (0, (POLICY.execute, POLICY.ensemble))],
)
def test_it_flies_its_newest_chunk_unless_the_policy_is_to_decide(shown, tmp_path, steps, flown):
    policy = trained(shown, tmp_path / "run", replace(SMALL, rounds=0, execute=steps))
    for each in (policy, aerial_il.load_policy(tmp_path / "run"), policy.fresh()):
        assert (each.config.execute, each.config.ensemble) == flown


def test_killed_between_rounds_it_ends_with_the_same_policy(shown, tmp_path, monkeypatch):
    whole = trained(shown, tmp_path / "whole")
    with monkeypatch.context() as slow:
        slow.setattr("aerial_il.algorithms.perception.time", SimpleNamespace(perf_counter=lambda: 1e3 * perf_counter()))
        trained(shown, tmp_path / "cut", replace(SMALL, rounds=1))
    shutil.rmtree(tmp_path / "cut" / "policy")
    shutil.rmtree(tmp_path / "cut" / "checkpoints" / "00000001")
    resumed = trained(shown, tmp_path / "cut")
    first, second = (row["elapsed_s"] for row in read_metrics(tmp_path / "cut"))
    assert second > first, "what it took before counts"
    shutil.rmtree(tmp_path / "cut" / "policy")
    ended = trained(shown, tmp_path / "cut")
    for again in (resumed, ended):
        assert again.origin["flights"] == whole.origin["flights"] == SMALL.episodes
        for one, other in zip(whole.eyes.parameters(), again.eyes.parameters(), strict=True):
            np.testing.assert_array_equal(one.detach().numpy(), other.detach().numpy())


def test_worlds_see_for_themselves(shown, tmp_path):
    """What is estimated in one world depends on no other, and an episode that begins anew remembers nothing."""
    policy = trained(shown, tmp_path / "run", replace(SMALL, rounds=0))
    with closing(environment("press_button", 3)) as env:
        obs = env.reset(60)
        both = policy.estimate(obs)
        alone = policy.fresh().estimate({name: values[1:2] for name, values in obs.items()})
        for name, values in both.items():
            np.testing.assert_allclose(values[1:2], alone[name], atol=1e-5)
        later = env.step(np.tile(policy.spec.action.low, (3, 1))).obs
        policy.estimate(later)
        policy.reset(np.array([True, False, False]))
        np.testing.assert_allclose(policy.estimate(obs)["button_pos"][0], both["button_pos"][0], atol=1e-5)


@pytest.mark.parametrize("tier", ["calm", "calm+looks:1"])
def test_each_frame_looks_as_another_episode_where_the_tier_says_so(shown, tier):
    flights, moments = [*open_dataset(shown)], [(0, 10)] * 3
    load = partial(aerial_il.load_batch, "fa_hexa_arm4", "press_button", num_envs=2, image_size=(32, 32))
    with closing(load(tier=tier, cameras=CAMERAS)) as env:
        parts = [*drawn(env, flights, moments, ("base_rgb", "button_pos"), looks=np.random.default_rng(0))]
    frames = Frames.joined(parts).obs
    assert np.ptp(frames["button_pos"], axis=0).max() == 0.0
    assert bool(np.ptp(frames["base_rgb"].astype(int), axis=0).any()) == (tier != "calm")


def test_scenes_are_redrawn_where_flights_differ(shown):
    demos = open_dataset(shown, cameras=())
    with closing(environment("press_button")) as env:
        starts = np.stack([demo.states[0] for demo in demos])
        redrawing = Redrawing(env.model, starts)
        (button,) = redrawing.movable  # with its post; no part of the robot
        assert len(button.beside) == 1
        tools = np.stack([demos[k].obs["ee_pos"][0] for k in range(2)])
        states = redrawing.redrawn(starts[:2], tools, np.random.default_rng(0))
        before, after = env.set_state(starts[:2]), env.set_state(states)
        assert (np.linalg.norm(after["button_pos"] - before["button_pos"], axis=1) > 1e-3).all()
        for name in ("base_pos", "ee_pos", "joint_pos"):
            np.testing.assert_array_equal(after[name], before[name])
        tip = after["button_pos"] - after["ee_pos"] - after["tip_to_button"]
        np.testing.assert_allclose(np.linalg.norm(tip, axis=1), 0.013, atol=1e-6)


def test_what_faces_the_robot_still_does_when_it_is_redrawn(shown):
    """Headings and tilts lie between those of the flights: a button seen from behind is none that is ever pressed."""
    demos = open_dataset(shown, cameras=())
    with closing(environment("press_button", 1)) as env:
        starts = np.concatenate([env.get_state() for seed in range(40) if env.reset(seed) is not None])
        redrawing = Redrawing(env.model, starts)
        tool, rng = demos[0].obs["ee_pos"][:1], np.random.default_rng(0)
        recorded, redrawn = (
            np.concatenate([env.set_state(state)["button_rot6d"] for state in states])
            for states in (starts[:, None], [redrawing.redrawn(starts[:1], tool, rng) for _ in range(60)])
        )
    for said in (lambda rot: np.arctan2(-rot[:, 3], rot[:, 4]), lambda rot: rot[:, 2]):  # heading, and tilt
        low, high = np.quantile(said(recorded), [0, 1])
        assert low - 0.05 < said(redrawn).min()
        assert said(redrawn).max() < high + 0.05
        assert np.ptp(said(redrawn)) > 0.6 * (high - low), "and they differ as much"


def test_what_is_in_the_gripper_stays_there(tmp_path):
    with closing(environment("pick_place", 1)) as env:
        env.reset(3)
        starts = np.concatenate([env.get_state() for seed in (3, 4, 5) if env.reset(seed) is not None])
        obs = env.set_state(starts[:1])
        redrawing = Redrawing(env.model, starts)
        held = redrawing.redrawn(starts[:1], obs["cube_pos"] + [0.0, 0.0, 0.5 * HELD_M], np.random.default_rng(1))
        after = env.set_state(held)
        np.testing.assert_array_equal(after["cube_pos"], obs["cube_pos"])
        assert np.linalg.norm(after["bowl_pos"] - obs["bowl_pos"]) > 1e-3
        assert after["bowl_pos"][0, 2] == obs["bowl_pos"][0, 2], "all bowls stand on the table"


def test_without_images_nothing_is_seen(shown, tmp_path):
    with closing(environment("press_button")) as env, pytest.raises(InvalidValueError, match=r"policy\.images=\[wrist"):
        SMALL.train(open_dataset(shown), MLP(), run=tmp_path / "run", env=env, collect=collect)


def test_labels_with_errors_are_refused(shown, tmp_path):
    load = partial(aerial_il.load_batch, "fa_hexa_arm4", "press_button", num_envs=2, image_size=(32, 32))
    demos, settings = open_dataset(shown, cameras=IMAGES), replace(SMALL, rounds=0)
    with closing(load(tier="gusts", cameras=CAMERAS)) as env:
        with pytest.raises(InvalidValueError, match="flight_tier=gusts-estimation"):
            trained_on(demos, tmp_path / "run", env, settings)
        assert not (tmp_path / "run").exists(), "before anything is learned"
    with closing(load(tier="gusts-estimation", cameras=CAMERAS)) as env:
        trained_on(demos, tmp_path / "run", env, settings)


@pytest.mark.parametrize(
    ("image", "said"),
    [("wrist_depth", "'wrist_depth' has no colours"), ("scene_rgb", r"'scene_rgb' is not taken .* carries \(wrist")],
)
def test_images_that_nothing_can_be_measured_in_are_refused_at_once(tmp_path, image, said):
    cameras = ("wrist:depth", "scene")
    load = partial(aerial_il.load_batch, "fa_hexa_arm4", "press_button", num_envs=1, image_size=(24, 24))
    with closing(load(cameras=cameras)) as env:
        collect(env, aerial_il.expert("fa_hexa_arm4", "press_button"), range(1), tmp_path / "demos", progress=False)
        demos, policy = open_dataset(tmp_path / "demos"), replace(POLICY, images=(image,))
        with pytest.raises(InvalidValueError, match=said):
            SMALL.train(demos, policy, run=tmp_path / "run", env=env, collect=collect, progress=False)
    assert not (tmp_path / "run").exists()


def test_other_cameras_than_were_learned_with_are_refused(shown, tmp_path, monkeypatch):
    policy = trained(shown, tmp_path / "run", replace(SMALL, rounds=0))
    robot = robots.get("fa_hexa_arm4")
    wider = tuple(replace(camera, fov=camera.fov + 15.0) for camera in robot.mounted_cameras)
    monkeypatch.setattr(robots, "get", lambda name: replace(robot, cameras=wider))
    with closing(environment("press_button")) as env:
        with pytest.raises(InvalidValueError, match=r"wrist_rgb is taken with \d+ degrees on the tool, not \d+"):
            policy.attach(env)
        with pytest.raises(
            InvalidValueError, match=r"other cameras than .*\(wrist: fov 90, now 105.*Record them again"
        ):
            SMALL.train(open_dataset(shown, cameras=IMAGES), POLICY, run=tmp_path / "again", env=env, collect=collect)


def test_late_and_rare_images_are_measured_from_where_they_were_taken(tmp_path):
    """Cameras at 25 Hz, one of them 40 ms late."""
    cameras = ("wrist@24x24@25Hz@40ms", "base@24x24")
    env = aerial_il.load_batch("fa_hexa_arm4", "press_button", num_envs=1, cameras=cameras)
    with closing(env):
        expert = aerial_il.expert("fa_hexa_arm4", "press_button")
        collect(env, expert, range(2), tmp_path / "demos", progress=False)
        demos = [*open_dataset(tmp_path / "demos", cameras=IMAGES)]
        policy = trained_on(demos, tmp_path / "run", env)
        looks = list[tuple[int, int, float, int]]()
        tell = policy.eyes.tell
        seen_at = iter(range(100))
        obs, step = env.reset(9), next(seen_at)
        places = [obs["ee_pos"][0, 0]]

        def noted(tracker, k, obs, then, age, mask):
            looks.append((step, k, float(then["ee_pos"][0, 0]), int(age[0])))
            tell(tracker, k, obs, then, age, mask)

        policy.eyes.tell = noted
        for _ in range(8):
            obs, step = env.step(policy.act(obs)).obs, next(seen_at)
            places.append(obs["ee_pos"][0, 0])
    wrist = [(step, then, age) for step, k, then, age in looks if k == 0]
    assert wrist == [(step, places[max(0, step - 2)], min(step, 2)) for step in (0, 4, 6)]
    assert [(step, age) for step, k, _, age in looks if k == 1] == [(0, 0), (2, 0), (4, 0), (6, 0)]


def test_a_device_that_is_not_there_is_refused_before_anything_is_learned(shown, tmp_path):
    with pytest.raises(InvalidValueError, match="device=toaster is none that torch knows"):
        trained(shown, tmp_path / "run", replace(SMALL, device="toaster"))
    assert not (tmp_path / "run").exists()


def test_frames_that_memory_does_not_hold_are_refused_before_anything_is_learned(shown, tmp_path):
    with pytest.raises(InvalidValueError, match=r"take [\d.]+ GiB of memory.*image_size=\[64,64\]"):
        trained(shown, tmp_path / "run", replace(SMALL, frames=10**9))
    assert not (tmp_path / "run").exists()


def test_several_tasks_are_refused_before_anything_is_learned(shown, tmp_path):
    with closing(environment("pull_lever")) as env:
        collect(env, aerial_il.expert("fa_hexa_arm4", "pull_lever"), range(1), tmp_path / "other", progress=False)
    both = [*open_dataset(shown, cameras=IMAGES), *open_dataset(tmp_path / "other", cameras=IMAGES)]
    with (
        closing(environment("press_button")) as env,
        pytest.raises(InvalidValueError, match="press_button, pull_lever"),
    ):
        trained_on(both, tmp_path / "run", env)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("eyes", [{"encoder": "resnet18"}, {"crop": 0.8}, {"image_features": 8}])
def test_settings_of_other_eyes_are_refused(shown, tmp_path, eyes):
    demos, policy = open_dataset(shown, cameras=IMAGES), replace(POLICY, **eyes)
    refused = pytest.raises(InvalidValueError, match=r"policy\.\w+ is of policies that go from images to actions")
    with closing(environment("press_button")) as env, refused:
        SMALL.train(demos, policy, run=tmp_path / "run", env=env, collect=collect, progress=False)


def test_a_robot_with_a_fixed_base_looks_through_its_tool_alone(tmp_path):
    with closing(aerial_il.load_batch("z1", "reach", num_envs=2, cameras=CAMERAS, image_size=(24, 24))) as env:
        collect(env, aerial_il.expert("z1", "reach"), range(4), tmp_path / "demos", progress=False)
        demos = open_dataset(tmp_path / "demos", cameras=IMAGES)
        with pytest.raises(InvalidValueError, match=r"on the base of z1.*images=\[wrist_rgb\]"):
            trained_on(demos, tmp_path / "run", env)
        policy = replace(POLICY, images=IMAGES[:1])
        seeing = SMALL.train(demos, policy, run=tmp_path / "run", env=env, collect=collect, progress=False)
        attach(seeing, env)
        assert np.isfinite(seeing.act(env.reset(5))).all()


def test_who_takes_over_in_mid_flight_measures_from_where_images_were_taken(shown, tmp_path):
    """A camera at 10 Hz, a policy that is set anew in its 13th step: from its second look on it is right again."""
    policy = trained(shown, tmp_path / "run", replace(SMALL, rounds=0))
    cameras = ("wrist@32x32@10Hz", "base@32x32@10Hz")
    with closing(aerial_il.load_batch("fa_hexa_arm4", "press_button", num_envs=1, cameras=cameras)) as env:
        expert = aerial_il.expert("fa_hexa_arm4", "press_button")
        attach(expert, env)
        slow = PerceivingPolicy(_seeing(policy.pilot, env.spec), policy.eyes, every=2, forget=0.9)
        obs, looks = env.reset(9), list[int]()
        slow.eyes.tell = lambda *_: looks.append(step)
        for step in range(30):
            if step == 13:
                slow.reset()
            slow.estimate(obs)
            obs = env.step(expert.act(obs)).obs
    assert looks == [each for step in (0, 5, 10, 13, 15, 20, 25) for each in (step, step)]


def _seeing(pilot, spec):
    layout = replace(pilot.interface.layout, spec=spec)
    return type(pilot)(pilot.config, replace(pilot.interface, layout=layout), pilot.network, pilot.origin)


def test_what_cannot_be_drawn_anew_is_refused_before_anything_is_learned(shown, tmp_path):
    demos = [replace(demo, states=demo.states[:, :0]) for demo in open_dataset(shown, cameras=IMAGES)]
    with (
        closing(environment("press_button")) as env,
        pytest.raises(InvalidValueError, match="has no states of the sim"),
    ):
        trained_on(demos, tmp_path / "run", env)
    assert not (tmp_path / "run").exists()

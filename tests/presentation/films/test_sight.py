"""Films of policies that look show what they see, and where they take things to be."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

import aerial_il
from aerial_il.core.contracts import attach
from aerial_il.policies.parts.vision import FAR_M
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import Targets
from aerial_il.presentation.films.sight import ESTIMATES, TRUTH, Sight
from aerial_il.presentation.films.video import sight_of
from tests.links.test_fly import fresh_policy

IMAGES = ("wrist_rgb", "base_rgb")
pytestmark = pytest.mark.render


def test_estimates_and_truth_are_drawn_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    env = aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=2, cameras=("wrist", "base"), image_size=(32, 32))
    with closing(env):
        obs = env.reset(3)
        flights = [{name: values.repeat(2, 0) for name, values in env.reset(seed).items()} for seed in range(4)]
        pilot = fresh_policy("mlp", spec=env.spec, hidden=(8,))
        targets = Targets.of(env.spec.observation, flights, env.spec.observation.state_names)
        policy = PerceivingPolicy(pilot, Eyes.of(env.spec, IMAGES, targets, 16), every=2, forget=0.9)
        sight = sight_of(policy)
        assert isinstance(sight, Sight)
        sight.look(obs)
        blank = sight.picture(400)
        assert blank.shape == (400, 200, 3)
        monkeypatch.setattr(sight, "_estimates", {name: obs[name][:1] for name in ("cube_pos", "bowl_pos")})
        drawn = sight.picture(400)
    for colour in (*ESTIMATES[:2], TRUTH):
        assert (drawn == colour).all(-1).any(), colour
    camera = policy.eyes.cameras[1]
    across, up, _ = camera.project(camera.pose(obs).seen(obs["cube_pos"]))[0]
    rows, columns = np.nonzero((drawn[200:] == TRUTH).all(-1))
    near = np.hypot(rows - 100 * (1 - up), columns - 100 * (1 + across)).min()
    assert near < 12


def test_the_truth_is_drawn_where_a_late_image_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cameras = ("wrist@32x32@10Hz@100ms", "base@32x32")
    with closing(aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=1, cameras=cameras)) as env:
        flights = [{name: values.repeat(2, 0) for name, values in env.reset(seed).items()} for seed in range(4)]
        targets = Targets.of(env.spec.observation, flights, env.spec.observation.state_names)
        pilot, obs = fresh_policy("mlp", spec=env.spec, hidden=(8,)), env.reset(3)
        policy = PerceivingPolicy(pilot, Eyes.of(env.spec, IMAGES, targets, 16), every=2, forget=0.9)
        expert, sight = aerial_il.expert("fa_hexa_arm4", "pick_place"), Sight(policy)
        attach(expert, env)
        past = [obs]
        for _ in range(22):
            sight.look(obs)
            obs = env.step(expert.act(obs)).obs
            past.append(obs)
        sight.look(obs)
        monkeypatch.setattr(sight, "_estimates", {name: obs[name] + 9.0 for name in ("cube_pos", "bowl_pos")})
        drawn = sight.picture(400)[:200]
    then = past[15]  # of the images taken at 0, 5, 10, 15 and 20, the newest that is 5 steps old
    across, up, _ = policy.eyes.cameras[0].project(policy.eyes.cameras[0].pose(then).seen(then["cube_pos"]))[0]
    rows, columns = np.nonzero((drawn == TRUTH).all(-1))
    assert np.hypot(rows - 100 * (1 - up), columns - 100 * (1 + across)).min() < 6


def test_depth_is_grey_from_near_to_far() -> None:
    env = aerial_il.load_batch("fa_hexa_arm4", "pick_place", num_envs=1, cameras=("base:depth",), image_size=(32, 32))
    with closing(env):
        obs = env.reset(3)
        policy = fresh_policy("mlp", spec=env.spec, hidden=(8,), images=("base_depth",))
        sight = sight_of(policy)
        assert isinstance(sight, Sight)
        sight.look(obs)
        grey = sight.picture(32)[..., 0]
    np.testing.assert_allclose(grey / 255, np.clip(obs["base_depth"][0] / FAR_M, 0.0, 1.0), atol=0.01)


def test_who_does_not_look_has_no_sight() -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1)
    with closing(env):
        assert sight_of(aerial_il.expert("ua_quad_arm4", "reach")) is None
        assert sight_of(fresh_policy("mlp", spec=env.spec, hidden=(8,))) is None

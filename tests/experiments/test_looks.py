"""What the study of flying by camera says of starts and of time, and what it deprives policies of."""

from contextlib import closing

import numpy as np
import pytest

import aerial_il
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import Targets
from aerial_il.policies.perception.tracker import Measurement, Tracker
from experiments.pixels.changes import DEPRIVED
from experiments.pixels.looks import IN_VIEW, begins_in_view, row_of_times, rows_of_starts
from tests.experiments.results import result_with
from tests.links.test_fly import fresh_policy

pytestmark = pytest.mark.render
IMAGES = ("wrist_rgb", "base_rgb")
SEEDS = range(10)


@pytest.fixture(scope="module")
def cell():
    env = aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=4, cameras=("wrist", "base"), image_size=(24, 24))
    with closing(env):
        flights = [{name: values.repeat(2, 0) for name, values in env.reset(seed).items()} for seed in range(4)]
        pilot = fresh_policy("mlp", spec=env.spec, hidden=(8,))
        targets = Targets.of(env.spec.observation, flights, env.spec.observation.state_names)
        yield env, PerceivingPolicy(pilot, Eyes.of(env.spec, IMAGES, targets, 8), every=2, forget=0.9)


def test_starts_tell_what_is_in_an_image(cell) -> None:
    """Success is counted apart, and nothing is lost between the two."""
    env, policy = cell
    found = begins_in_view(env, policy, SEEDS)
    assert list(found) == [*SEEDS]
    assert {*found.values()} == {True, False}, "of reach about half begin in view"
    for seed in SEEDS:
        obs = env.reset(np.full(4, seed))
        seen = [camera.in_view(camera.pose(obs).seen(obs["target_pos"]))[0] for camera in policy.eyes.cameras]
        assert found[seed] == any(seen)
    rows = [*rows_of_starts(result_with(10, 4), found)]
    assert sum(row["success"] for row in rows) == 4
    assert sum(row["episodes"] for row in rows) == 10
    first = rows[0]
    assert first["starts"] == IN_VIEW
    assert first["episodes"] == sum(found.values())
    assert first["flights_low"] <= first["percent"] <= first["flights_high"]


def test_times_are_of_one_world(cell) -> None:
    _, policy = cell
    with closing(
        aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=1, cameras=("wrist", "base"), image_size=(24, 24))
    ) as env:
        row = row_of_times(env, policy, 3, 40)
    assert 0.0 < row["act_median_ms"] <= row["act_p99_ms"] < row["both_p99_ms"]


def test_policies_are_deprived_of_what_is_said(cell) -> None:
    env, policy = cell
    first, second = (DEPRIVED[f"{which} camera alone"](policy) for which in ("first", "second"))
    assert [each.image for one in (first, second) for each in one.eyes.cameras] == [*IMAGES]
    assert (DEPRIVED["10 Hz"](policy).every, DEPRIVED["the last look alone"](policy).every) == (5, policy.every)
    obs = env.reset(5)
    dark = {name: np.zeros_like(obs[name]) for name in IMAGES}
    for one, unseen in ((first, "base_rgb"), (second, "wrist_rgb")):
        whole, half = (one.fresh().estimate(obs | other)["target_rot6d"] for other in ({}, {unseen: dark[unseen]}))
        np.testing.assert_array_equal(whole, half, "it looks through the other camera")
        assert not np.array_equal(whole, one.fresh().estimate(obs | dark)["target_rot6d"])


def test_of_the_last_look_alone_none_before_is_left(cell) -> None:
    """Whatever was told before, a look counts as the first one does."""
    _, policy = cell
    place = next(each for each in policy.eyes.targets.estimated if each.field == "target_pos")
    tracker, every = Tracker([place], DEPRIVED["the last look alone"](policy).forget), np.ones(1, bool)
    tracker.begin(every)
    for where in (0.0, 0.0, 0.0, 0.1):
        tracker.fade(every)
        tracker.tell(place.field, every, Measurement(place.centre[None] + where, np.full((1, 3, 3), 1e-6) * np.eye(3)))
    np.testing.assert_allclose(tracker.estimate(place.field)[0], place.centre + 0.1, atol=2e-3)

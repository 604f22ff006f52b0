"""What the study of flying by camera says of starts, and of time."""

from contextlib import closing

import numpy as np
import pytest

import aerial_il
from aerial_il.policies.perception.eyes import Eyes
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import Targets
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

"""The whole path on real robots: the expert flies, the recording replays from any step, files do not depend on n."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.replay import replay
from aerial_il.suite.scenario import horizon_of


@pytest.mark.parametrize(("robot", "task"), [("ua_quad_arm4", "pick_place"), ("fa_hexa_arm4", "reach")])
def test_a_flight_in_gusts_is_recorded_and_replays(tmp_path: Path, robot: str, task: str) -> None:
    digests = []
    for num_envs in (1, 3):
        env = aerial_il.load_batch(robot, task, tier="gusts", num_envs=num_envs)
        expert = aerial_il.expert(robot, task)
        folder = collect(env, expert, range(2), tmp_path / str(num_envs), progress=False).folder
        digests.append([hashlib.sha256(f.read_bytes()).digest() for f in folder.files() + folder.files("failures")])
    assert digests[0] == digests[1]
    episode = open_dataset(folder.path, failures=True)[0]
    assert episode.spec == env.spec
    starts = np.linspace(0, len(episode) - 1, 3).astype(int).tolist()
    assert replay(env, episode, starts=starts) == sum(len(episode) - start for start in starts)


def test_with_a_horizon_flights_go_on_through_success(tmp_path: Path) -> None:
    env = aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=2, horizon=220)
    folder = collect(env, aerial_il.expert("fa_hexa_arm4", "reach"), range(2), tmp_path, progress=False).folder
    flights = list(open_dataset(folder.path))
    assert [len(flight) for flight in flights] == [220, 220]
    assert all(flight.success and flight.truncated[-1] and not flight.terminated.any() for flight in flights)
    assert horizon_of(flights[0].spec) == 220
    assert horizon_of(aerial_il.load_batch("fa_hexa_arm4", "reach", num_envs=1).spec) is None


def test_a_horizon_beyond_the_time_limit_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"horizon is 1001; it must lie in \[1, 1000\]: reach has a time limit"):
        aerial_il.load_batch("fa_hexa_arm4", "reach", horizon=1001)


@pytest.mark.render
def test_pictures_stay_with_their_steps_when_other_worlds_land(tmp_path: Path) -> None:
    """Worlds that land at different steps: each file is the one that a world alone writes."""
    found = []
    for num_envs in (1, 3):
        env = aerial_il.load_batch("quad", "hover", num_envs=num_envs, cameras=("scene",), image_size=(24, 32))
        folder = collect(
            env, aerial_il.expert("quad", "hover"), range(4), tmp_path / str(num_envs), progress=False
        ).folder
        found.append({file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.files()})
    assert found[0] == found[1]
    flights = list(open_dataset(folder.path))
    assert len({len(flight) for flight in flights}) > 1, "they land at different steps"

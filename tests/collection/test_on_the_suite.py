"""The whole path on real robots: the expert flies, the recording replays from any step, files do not depend on n."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.data.dataset import open_dataset
from aerial_il.data.replay import replay


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

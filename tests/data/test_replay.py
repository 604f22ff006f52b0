"""A recording replays bit for bit from any of its steps, and the first divergence is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import DemoError
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from tests.data.crane import CraneBatch


def test_replays_from_every_step(demo: Path) -> None:
    episode = read_episode(demo)
    count = len(episode)
    assert replay(CraneBatch(4), episode, starts=range(count)) == count * (count + 1) // 2


def test_names_the_first_divergence(demo: Path) -> None:
    episode = read_episode(demo)
    states = episode.states.copy()
    states[7, 2] += 1e-15
    with pytest.raises(DemoError, match=r"topic /step, step 7, field state\[2\]"):
        replay(CraneBatch(), replace(episode, states=states))
    actions = episode.executed_actions.copy()
    actions[5] += 1e-3
    with pytest.raises(DemoError, match="step 5, field reward"):
        replay(CraneBatch(), replace(episode, executed_actions=actions))
    rewards = np.where(np.arange(len(episode)) == 2, 0.5, episode.rewards)
    with pytest.raises(DemoError, match=r"an outcome differs.*step 2, field reward"):
        replay(CraneBatch(), replace(episode, rewards=rewards))


def test_refuses_what_cannot_be_compared(demo: Path) -> None:
    episode, env = read_episode(demo), CraneBatch()
    with pytest.raises(DemoError, match="another environment: max_steps"):
        replay(CraneBatch(max_steps=5), episode)
    with pytest.raises(DemoError, match="another scene"):
        replay(env, replace(episode, model_xml="<mujoco/>"))
    with pytest.raises(DemoError, match="another MuJoCo"):
        replay(env, replace(episode, provenance={"mujoco": "2.0.0"}))
    with pytest.raises(DemoError, match="cannot resume there"):
        replay(env, episode, starts=[len(episode)])

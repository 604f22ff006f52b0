"""The target runs on a closed curve as announced, and a lap counts only if it was followed without a break."""

from __future__ import annotations

import numpy as np

from aerial_il.experts.track import TrackExpert
from aerial_il.suite.tasks import track
from tests.contract.registered import batch, hold_actions

CELL = ("ua_quad_arm4", "track")


def test_the_target_goes_where_the_preview_says_and_comes_round() -> None:
    worlds = batch(*CELL)
    first = worlds.reset(7)
    hover = hold_actions(worlds)
    announced = first["tool_to_preview"][:, :3] + first["ee_pos"]
    lap = np.ceil(track.FULL_LAP / np.abs(worlds.simulation.view.task_state[:, track.RATE]) / 0.02)
    positions = []
    for _ in range(int(lap.max()) + 1):
        obs = worlds.step(hover).obs
        positions.append(obs["target_pos"])
        if len(positions) == 10:
            np.testing.assert_allclose(obs["target_pos"], announced, atol=1e-9)
    path = np.array(positions)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=2).max(axis=0) / 0.02
    assert ((speed > track.SPEED_M_S[0] - 0.01) & (speed < track.SPEED_M_S[1] + 0.01)).all()
    for world in range(3):
        gap = np.linalg.norm(path[int(lap[world]) - 1, world] - first["target_pos"][world])
        assert gap < track.SPEED_M_S[1] * 0.02, "one lap later it is within a step of where it started"


def test_a_tool_that_stands_still_never_completes_a_lap() -> None:
    worlds = batch(*CELL)
    obs = worlds.reset(7)
    hover = np.concatenate([obs["target_pos"], obs["ee_rot6d"], np.ones((3, 1))], axis=1)
    while not worlds.simulation.reassess().truncated.any():
        assert not worlds.step(hover).info["success"].any()


def test_losing_the_target_breaks_the_lap_off() -> None:
    worlds = batch(*CELL)
    expert = TrackExpert()
    expert.attach(worlds)
    worlds.reset(7)
    expert.reset()
    for _ in range(200):
        worlds.step(expert.act({}))
    memory = worlds.simulation.view.task_state
    assert (memory[:, track.LAP] > 0.5).all()
    while (memory[:, track.LAP] > 0.0).any():
        worlds.step(expert.act({}) + np.eye(10)[2] * 0.3)
    assert not worlds.step(expert.act({})).info["subtasks"][:, 1:].any()

"""Gusts, pushes and slips at a person's word: they move the vehicle, and come again, to the bit, in both replays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.perturb import GUST_MPS, PUSH_MPS, Perturber, possible
from aerial_il.teleop.session.refly import refly
from tests.teleop.hands import schedule, shipped, world


def flown(env, out: Path, *parts: tuple[int, int, list[str]], ticks: int = 160) -> Cockpit:
    """Record so many ticks, in which parts are pressed."""
    cockpit = Cockpit(env, shipped("scripted"), Logbook(env, str(out), operator="ada", first_seed=5000), countdown=3)
    script = schedule((1, 2, ["record"]), *parts, (ticks, ticks + 1, ["record"]), (ticks + 2, ticks + 3, ["save"]))
    device = Scripted(script, cockpit.bindings)
    for _ in range(ticks + 5):
        cockpit.tick(device.frame())
    cockpit.close()
    return cockpit


def test_gust_push_and_slip_come_again_in_both_replays(tmp_path: Path) -> None:
    env = world(task="pick_place", tier="gusts")
    flown(env, tmp_path, (10, 40, ["grip+"]), (30, 31, ["gust"]), (90, 91, ["push"]), (120, 121, ["drop"]))
    (file,) = DatasetFolder(tmp_path).files("failures")
    episode = read_episode(file)
    rows = episode.extras["perturbation"]
    np.testing.assert_allclose(np.linalg.norm(rows[:80, :3].sum(axis=0)), GUST_MPS, rtol=1e-9)
    assert np.count_nonzero(rows[:, :3].any(axis=1)) == 51
    np.testing.assert_allclose(np.linalg.norm(rows[80:, :3], axis=1).max(), PUSH_MPS)
    slipping = rows[:, 3] == 1.0
    assert np.count_nonzero(slipping) == 20
    assert (episode.executed_actions[slipping, -1] == 1.0).all()
    assert (episode.actions[slipping, -1] < 1.0).all(), "the person did not open"
    np.testing.assert_array_equal(episode.labels[slipping], episode.actions[slipping], "nobody learns to let go")
    np.testing.assert_array_equal(episode.labels[~slipping], episode.executed_actions[~slipping])
    assert "gust at step" in episode.provenance["note"]
    assert replay(env, episode, starts=(0, 30, 90)) > len(episode)
    assert refly(env, episode) == len(episode)


def test_a_recording_without_its_push_does_not_replay(tmp_path: Path) -> None:
    env = world()
    flown(env, tmp_path, (30, 31, ["push"]), ticks=60)
    episode = read_episode(DatasetFolder(tmp_path).files("failures")[0])
    rows = episode.extras["perturbation"].copy()
    rows[:] = 0.0
    quiet = replace(episode, extras={**episode.extras, "perturbation": rows})
    with pytest.raises(DemoError, match="does not replay"):
        replay(env, quiet)
    with pytest.raises(DemoError, match="perturbation"):
        refly(env, quiet)


def test_without_a_perturbation_nothing_of_a_flight_changes(tmp_path: Path) -> None:
    env = world(tier="gusts")
    flown(env, tmp_path, (10, 40, ["forward+"]), ticks=60)
    episode = read_episode(DatasetFolder(tmp_path).files("failures")[0])
    assert not episode.extras["perturbation"].any()
    plain = replace(episode, extras={name: values for name, values in episode.extras.items() if name == "device"})
    assert replay(env, plain) == len(episode)


def test_what_cannot_happen_is_refused_by_name(tmp_path: Path) -> None:
    env = world(task="reach")
    assert possible(env) == ("gust", "push")
    cockpit = flown(env, tmp_path, ticks=20)
    cockpit.tick(Scripted(lambda _: ["drop"], cockpit.bindings).frame())
    assert "reach" in cockpit.message
    assert "could fall" in cockpit.message
    fixed = world("z1")
    assert "push" not in possible(fixed)
    with pytest.raises(InvalidValueError, match="stands fixed"):
        fixed.push(np.ones((1, 3)))


def test_directions_follow_from_the_seed() -> None:
    env = world()
    first, again, other = (Perturber(env, seed).step(["push"]).velocity for seed in (5000, 5000, 5001))
    np.testing.assert_array_equal(first, again)
    assert abs(first - other).max() > 1e-3

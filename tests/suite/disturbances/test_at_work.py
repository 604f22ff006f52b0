"""A tier at work: each component alone does what it should and nothing else, and all of it resumes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aerial_il.collection.collect import collect
from aerial_il.control.controller_state import FORCE
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.dataset import open_dataset
from aerial_il.experts import make
from aerial_il.suite import disturbances, tiers
from aerial_il.suite.disturbances import latency
from aerial_il.suite.disturbances.wind import air_about
from aerial_il.suite.episode.disturbances import effects_of
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import batch, hold_actions, single

ROBOT, TASK = "ua_quad_arm4", "pick_place"
SEEDS = np.array([3, 7, 21])
IN_HARD = tuple(name for name in tiers.components() if "hard" in disturbances.strengths(name))
each_component = pytest.mark.parametrize("component", IN_HARD)


def flown(tier: str, level: str = "velocity", steps: int = 12, seeds: np.ndarray = SEEDS) -> tuple[dict, np.ndarray]:
    """First observation, and base poses (steps, n, 7) of a flight with the same slow commands in every tier."""
    worlds = batch(ROBOT, TASK, tier, level)
    obs, poses = worlds.reset(seeds), []
    for k in range(steps):
        action = np.zeros((len(seeds), worlds.spec.action.size))
        action[:, :3], action[:, -1] = 0.2 * np.sin([0.4 * k, 0.3 * k, 0.2 * k]), 1.0
        worlds.step(action)
        poses.append(worlds.simulation.view.qpos[:, :7].copy())
    return obs, np.stack(poses)


@pytest.mark.parametrize("tier", [*tiers.names(), *(f"calm+{name}" for name in tiers.components())])
def test_the_same_seed_starts_alike_in_every_tier(tier: str) -> None:
    calm, other = batch(ROBOT, TASK, "calm", "velocity"), batch(ROBOT, TASK, tier, "velocity")
    starts = calm.reset(SEEDS), other.reset(SEEDS)
    for name in ("qpos", "qvel", "mocap_pos", "mocap_quat"):
        np.testing.assert_array_equal(
            *(getattr(worlds.simulation.view, name) for worlds in (calm, other)), err_msg=name
        )
    if "estimation" not in tiers.get(tier).parts:
        for name, value in starts[0].items():
            np.testing.assert_array_equal(value, starts[1][name], err_msg=name)


@each_component
def test_a_component_alone_changes_only_its_own_memory(component: str) -> None:
    """Friction shows in contact only, estimation in what is observed; the others show in the air."""
    tier = f"calm+{component}"
    _, calm = flown("calm")
    _, disturbed = flown(tier)
    alike = np.allclose(calm, disturbed, rtol=0.0, atol=1e-12)  # the solver takes all contacts at once, and rounds
    assert alike == (component in ("friction", "estimation"))
    worlds = batch(ROBOT, TASK, tier, "velocity")
    worlds.reset(SEEDS)
    userdata, model = worlds.simulation.view.userdata, worlds.simulation.worlds.model
    for name, part in layout.MEMORIES.items():
        assert userdata[:, part].any() == (name in ("noise", component)), name
    own = [worlds.simulation.worlds.own_model(i) for i in range(3)]
    changed = {
        "payload": [not np.array_equal(m.body_mass, model.body_mass) for m in own],
        "friction": [not np.array_equal(m.geom_friction, model.geom_friction) for m in own],
        "motors": [bool((gain != 1.0).any()) for gain in worlds.simulation.disturbances.rotor_gain],
    }
    for owner, worlds_changed in changed.items():
        assert all(worlds_changed) if component == owner else not any(worlds_changed)


@each_component
def test_leaving_a_component_out_leaves_the_others_draws_alone(component: str) -> None:
    hard, without = (batch(ROBOT, TASK, t).drawn(5) for t in ("hard", f"hard-{component}"))
    assert without == {name: hard[name] for name in without}
    gone = set(hard) - set(without)
    assert bool(gone) == (component != "noise")
    states = [batch(ROBOT, TASK, t) for t in ("hard", f"hard-{component}")]
    for worlds in states:
        worlds.reset(SEEDS)
    for owner, part in layout.MEMORIES.items():
        if owner != component:
            a, b = (worlds.simulation.view.userdata[:, part] for worlds in states)
            np.testing.assert_array_equal(a, b)


def test_late_actions_fly_as_the_same_actions_sent_later() -> None:
    worlds, prompt = batch(ROBOT, TASK, "calm+latency", "velocity"), batch(ROBOT, TASK, "calm", "velocity")
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.3, 0.3, (10, 3, worlds.spec.action.size))
    actions[..., -1] = 1.0
    stay = np.zeros((3, worlds.spec.action.size))
    stay[:, -1] = 1.0
    worlds.reset(SEEDS)
    delays = worlds.simulation.view.userdata[:, layout.MEMORIES["latency"].start].astype(int)
    assert set(delays) == {1, 2}, "these seeds show both"
    late = []
    for action in actions:
        result = worlds.step(action)
        np.testing.assert_array_equal(result.info["executed_action"], action, err_msg="what was sent is what is learnt")
        late.append(worlds.simulation.view.qpos.copy())
    prompt.reset(SEEDS)
    for k in range(10):
        shifted = np.stack([actions[k - d, i] if k >= d else stay[i] for i, d in enumerate(delays)])
        prompt.step(shifted)
        np.testing.assert_array_equal(prompt.simulation.view.qpos, late[k])


def test_the_queue_is_first_in_first_out() -> None:
    for delay, arrived in ((0, [1, 2, 3, 4, 5]), (1, [0, 1, 2, 3, 4]), (2, [0, 0, 1, 2, 3])):
        memory, seen = np.zeros(latency.Latency().memory), []
        memory[latency.DELAY] = delay
        for k in range(1, 6):
            action = np.full(2, float(k))
            latency.arrive.py_func(None, memory, None, action)
            seen.append(action[0])
        assert seen == arrived


def test_both_delays_are_drawn_equally_often() -> None:
    drawn = [batch(ROBOT, TASK, "hard").drawn(seed)["latency_steps"] for seed in range(300)]
    assert set(drawn) == {1, 2}
    assert 0.4 < np.mean(np.array(drawn) == 1) < 0.6


@pytest.mark.parametrize("level", ["ee_pose", "ee_delta", "base_joint", "velocity", "ctbr", "rotor"])
def test_until_the_first_action_arrives_the_vehicle_stays(level: str) -> None:
    worlds = batch(ROBOT, TASK, "calm+latency", level)
    obs = worlds.reset(SEEDS)
    worlds.step(np.repeat(worlds.spec.action.high[None], 3, axis=0))
    speed = np.abs(worlds.observe()["base_vel"]).max()
    assert speed < 0.05
    np.testing.assert_allclose(worlds.observe()["joint_pos"], obs["joint_pos"], atol=0.05)


def test_model_parameters_follow_the_state() -> None:
    worlds, env = batch(ROBOT, TASK, "hard"), single(ROBOT, TASK, "hard")
    worlds.reset(SEEDS)
    states, models = worlds.get_state(), worlds.simulation.worlds
    base = worlds.model.body("base").id

    def masses() -> np.ndarray:
        return np.array([models.own_model(i).body_subtreemass[base] for i in range(3)])

    first = masses()
    vehicle = Scenario(ROBOT, TASK).robot.vehicle.mass
    extra = [worlds.drawn(int(seed))["base_mass"] for seed in SEEDS]
    np.testing.assert_allclose(first, vehicle + np.array(extra))
    worlds.set_state(states[::-1].copy())
    np.testing.assert_array_equal(masses(), first[::-1])
    env.reset(seed=1)
    env.set_state(states[1:2])
    assert env.physics.model.body_subtreemass[base] == first[1]
    np.testing.assert_array_equal(env.physics.model.ptr.dof_invweight0, models.own_model(1).dof_invweight0)


def test_rotors_push_by_their_own_gain() -> None:
    env = single(ROBOT, TASK, "calm+motors", "rotor")
    env.reset(seed=4)
    gains = env.simulation.disturbances.drawn(4)["rotor_gain"]
    view, applied = env.simulation.view, env.physics.data.qfrc_applied
    push = env.scenario.rotors.T @ (gains * view.thrust[0])
    env.simulation.receive(env.spec.action.clip(np.full((1, env.spec.action.size), 5.0)))
    env.simulation.fly(1)
    np.testing.assert_allclose(applied[2:6], push[2:], rtol=2e-3, atol=1e-4)


def test_an_unknown_mass_is_learnt_by_the_observer() -> None:
    worlds = batch(ROBOT, "reach", "calm+payload-noise")
    obs = worlds.reset(SEEDS)
    stay = hold_actions(worlds)
    for _ in range(150):
        worlds.step(stay)
    extra = np.array([worlds.drawn(int(seed))["base_mass"] for seed in SEEDS])
    estimate = worlds.simulation.view.userdata[:, FORCE + 2]
    np.testing.assert_allclose(estimate, -9.81 * extra, atol=0.02 * 9.81 * 2.3)
    assert np.abs(worlds.observe()["ee_pos"] - obs["ee_pos"]).max() < 0.005


def test_the_specification_records_the_tier_in_full() -> None:
    spec = Scenario(ROBOT, TASK, "hard").spec
    described = json.loads(json.dumps(spec.to_dict()))["disturbances"]
    assert tuple(described) == IN_HARD
    assert described["wind"]["share"] == 0.13
    assert described["wind"]["speed_at_6m_m_s"] == pytest.approx(
        air_about(Scenario(ROBOT, TASK).robot.vehicle, 0.13).speed
    )
    assert EnvSpec.from_dict(spec.to_dict()) == spec
    assert Scenario(ROBOT, TASK, "calm+wind+latency").spec.tier == Scenario(ROBOT, TASK, "calm+latency+wind").spec.tier
    assert Scenario(ROBOT, TASK).spec.differences(spec) == [], "policies and datasets go across tiers"


def test_films_read_what_a_recorded_flight_was_disturbed_by() -> None:
    worlds = batch(ROBOT, TASK, "gusts")
    worlds.reset(SEEDS)
    worlds.step(hold_actions(worlds))
    effects = effects_of(worlds.spec, worlds.model, worlds.get_state())
    np.testing.assert_array_equal(effects["wind"], worlds.simulation.disturbances.table.effects["wind"])
    assert np.abs(effects["wind"]).max() > 1.0
    calm = batch(ROBOT, TASK)
    assert not effects_of(calm.spec, calm.model, worlds.get_state())["wind"].any()


def test_a_recording_says_what_disturbed_it(tmp_path: Path) -> None:
    worlds = batch(ROBOT, "reach", "hard")
    collect(worlds, make(ROBOT, "reach"), [7], tmp_path, progress=False)
    folder = open_dataset(str(tmp_path))
    (episode,) = list(folder)
    assert episode.provenance["tier"] == "hard"
    assert episode.provenance["disturbances"] == worlds.spec.disturbances
    assert episode.provenance["drawn"] == json.loads(json.dumps(worlds.drawn(7)))


def test_at_half_the_rate_every_other_action_holds_for_two_steps() -> None:
    slow, calm = batch(ROBOT, TASK, "calm+rate:25", "velocity"), batch(ROBOT, TASK, "calm", "velocity")
    slow.reset(SEEDS), calm.reset(SEEDS)
    actions = np.random.default_rng(4).uniform(-0.3, 0.3, (10, len(SEEDS), calm.spec.action.size))
    for step, action in enumerate(actions):
        slow.step(action), calm.step(actions[step - step % 2])
        np.testing.assert_array_equal(slow.simulation.view.qpos, calm.simulation.view.qpos)
    assert slow.spec.disturbances["rate"]["every"] == 2
    with pytest.raises(InvalidValueError, match=r"30 Hz is no whole .*: 50 or 25 or 16\.7"):
        tiers.get("calm+rate:30")

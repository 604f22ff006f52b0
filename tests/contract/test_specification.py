"""What every cell says about itself is true, and what it answers is what it said."""

from __future__ import annotations

import json

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.actions import WORKSPACE_HIGH, ActionLevel, hover_action
from aerial_il.core.specs import EnvSpec
from aerial_il.suite import tasks
from aerial_il.suite.tasks import CellError
from aerial_il.suite.tasks.pick_place import PickPlace
from tests.contract.registered import (
    CELLS,
    batch,
    each_cell,
    each_cell_and_level,
    each_cell_and_tier,
    levels,
    random_actions,
    single,
)

INFO = {
    *("success", "crash", "dropped", "sparse_reward", "subtasks", "ee_error_m", "effort", "contacts"),
    *("force_in_band_raw", "executed_action"),
}


def test_all_supported_robots_and_tasks_are_there() -> None:
    assert {"ua_quad_arm4", "fa_hexa_arm4"} <= set(aerial_il.list_robots())
    assert {"reach", "pick_place"} <= set(aerial_il.list_tasks())
    assert len(CELLS) >= 4
    assert levels("fa_hexa_arm4") == ("ee_pose", "ee_delta", "base_joint", "velocity", "ctbr", "rotor")
    assert levels("z1") == ("ee_pose", "ee_delta", "base_joint", "velocity")


@each_cell_and_tier
def test_observations_and_rewards_are_as_specified(robot: str, task: str, tier: str) -> None:
    worlds = batch(robot, task, tier)
    spec = worlds.spec
    obs = worlds.reset(3)
    for actions in random_actions(spec.action, 40, 3):
        assert set(obs) == set(spec.observation.names)
        for field in spec.observation.fields:
            assert obs[field.name].shape == (3, *field.shape)
            assert obs[field.name].dtype == np.dtype(field.dtype)
            assert np.isfinite(obs[field.name]).all(), field.name
        result = worlds.step(actions)
        obs = result.obs
        assert ((result.reward >= 0.0) & (result.reward <= 1.0)).all()
        assert set(result.info) == INFO
        assert result.info["subtasks"].shape == (3, len(spec.subtasks))
        assert result.info["success"].dtype == result.info["crash"].dtype == bool
        assert ((result.info["effort"] >= 0.0) & (result.info["effort"] <= 1.0)).all()
        np.testing.assert_array_equal(
            result.info["executed_action"], np.clip(actions, spec.action.low, spec.action.high)
        )


@each_cell
def test_an_observation_is_not_a_view_that_changes_later(robot: str, task: str) -> None:
    worlds = batch(robot, task)
    obs = worlds.reset(3)
    kept = {name: value.copy() for name, value in obs.items()}
    for actions in random_actions(worlds.spec.action, 3, 3):
        worlds.step(actions)
    for name, value in obs.items():
        np.testing.assert_array_equal(value, kept[name], err_msg=name)


@each_cell
def test_every_observation_varies(robot: str, task: str) -> None:
    """In the hands of the expert: what is felt in contact stays at zero until something is touched."""
    worlds, expert = batch(robot, task), aerial_il.expert(robot, task)
    expert.attach(worlds)
    obs = first = worlds.reset(3)
    expert.reset()
    constant = set(worlds.spec.observation.names)
    for _ in range(worlds.spec.max_steps):
        constant -= {name for name in constant if np.ptp(obs[name], axis=0).max() > 1e-6}
        constant -= {name for name in constant if np.abs(obs[name] - first[name]).max() > 1e-6}
        if not constant:
            return
        obs = worlds.step(expert.act(obs)).obs
    raise AssertionError(f"{', '.join(sorted(constant))} never changed")


@each_cell_and_level
def test_action_bounds_labels_and_units(robot: str, task: str, level: str) -> None:
    spec = single(robot, task, "calm", level).spec.action
    assert spec.level == level
    assert len(set(spec.labels)) == spec.size
    assert np.isfinite(spec.low).all()
    assert np.isfinite(spec.high).all()
    assert ("gripper" in spec.labels) == robots.get(robot).has_gripper
    if robots.get(robot).has_gripper:
        assert (spec.labels[-1], spec.low[-1], spec.high[-1]) == ("gripper", 0.0, 1.0)
    array = single(robot, task, "calm", level).action_spec()
    np.testing.assert_array_equal(array.minimum, spec.low)
    np.testing.assert_array_equal(array.maximum, spec.high)


@pytest.mark.parametrize("level", ["ee_pose", "velocity"])
@each_cell
def test_a_vehicle_can_hover(robot: str, task: str, level: str) -> None:
    env = single(robot, task, "calm", level)
    obs = env.reset(seed=1).observation
    vehicle = env.simulation.robot.vehicle
    assert vehicle.thrust_to_weight > 1.8 or env.simulation.robot.fixed
    base = env.simulation.view.base_pos.copy()
    action = hover_action(ActionLevel.parse(level), vehicle, obs["ee_pos"], obs["ee_rot6d"])
    assert (env.spec.action.clip(action) == action).all()
    for _ in range(150):
        timestep = env.step(action)
    assert np.linalg.norm(timestep.observation["ee_pos"] - obs["ee_pos"]) < 0.03
    assert np.linalg.norm(env.simulation.view.base_pos - base) < 0.04
    assert not env.info["crash"]
    assert not env.info["success"]


@each_cell
def test_the_specification_survives_json(robot: str, task: str) -> None:
    spec = single(robot, task).spec
    again = EnvSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert again.differences(spec, ignore=()) == []
    assert len(spec.instruction.split()) >= 4
    assert spec.instruction.endswith(".")
    assert spec.max_steps * spec.control_dt_s == pytest.approx(tasks.get(task).time_limit_s)
    assert single(robot, task).get_state().shape == (1, spec.state_size)


@each_cell_and_tier
def test_episodes_start_in_the_workspace_and_differ(robot: str, task: str, tier: str) -> None:
    worlds = batch(robot, task, tier, num_envs=16)
    obs = worlds.reset(100)
    on_skids = obs["ee_pos"][:, 2] < 0.15  # a bare base that stands on the ground
    assert ((obs["ee_pos"] > [-1.3, -1.3, 0.3]).all(axis=1) | on_skids).all()
    assert (obs["ee_pos"] < WORKSPACE_HIGH).all()
    assert np.ptp(obs["ee_pos"][:, : 2 if on_skids.all() else 3], axis=0).min() > 0.05
    assessment = worlds.simulation.reassess()
    assert not assessment.success.any()
    assert not assessment.crash.any()
    assert not assessment.contacts.any()


def test_a_robot_that_cannot_says_which_can(monkeypatch: pytest.MonkeyPatch) -> None:
    def infeasibility(_: PickPlace, robot: object) -> str | None:
        return "its gripper is too small" if getattr(robot, "name", "") == "ua_quad_arm4" else None

    monkeypatch.setattr(PickPlace, "own_infeasibility", infeasibility)
    tasks.cells.cache_clear()
    try:
        assert ("ua_quad_arm4", "pick_place") not in aerial_il.list_cells()
        with pytest.raises(CellError, match="ua_quad_arm4 cannot do pick_place: its gripper is too small") as caught:
            aerial_il.load("ua_quad_arm4", "pick_place")
        able = str(caught.value).split("Robots that can: ")[1]
        assert "fa_hexa_arm4" in able
        assert "ua_quad_arm4" not in able
        with pytest.raises(CellError):
            aerial_il.expert("ua_quad_arm4", "pick_place")
    finally:
        tasks.cells.cache_clear()

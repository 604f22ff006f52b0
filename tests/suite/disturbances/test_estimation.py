"""What policies are shown differs from the truth as the tier declares, consistently, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rotations import mat_from_rot6d
from aerial_il.suite import tasks, tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.disturbances.estimation import Estimation
from aerial_il.suite.episode.simulation import STATE_OFFSET
from aerial_il.suite.physics import episode_state
from aerial_il.suite.physics.world import Names
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tasks.pick_place import PickPlace
from aerial_il.suite.tasks.reach import Reach
from aerial_il.suite.tasks.track import Track
from aerial_il.suite.tiers import Tier
from tests.contract.registered import SAMPLE, hold_actions, random_actions

ROBOT, STEPS = "fa_hexa_arm4", 150
DECLARED = Estimation()
NO_ERROR = Estimation(0.0, 0.0, 0.0, 0.0, 0.0, force_bias=0.0, force_noise=0.0, lag=0)
ENCODERS = {"joint_pos", "joint_vel", "gripper"}
MARKED = {"lap", "peak_force", "slip"}  # of which the page says that no robot has them
COUNTED = {"turn", "is_in", "dirt", "wiped", "through", "picked"}  # told apart without a measure: exact in every tier
COUNTED |= {"thrust_share", "perched_s"}  # the robot's own rotors, and its own clock
type Load = Callable[..., BatchEnvironment]


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> Load:
    """Load worlds without disturbances but ``estimation``."""

    def make(task: str, estimation: Estimation | None, n: int = 3, robot: str = ROBOT) -> BatchEnvironment:
        tier = Tier("calm", {"estimation": estimation} if estimation else {})
        monkeypatch.setattr(Scenario, "tier", property(lambda scenario: tier))
        return aerial_il.load_batch(robot, task, num_envs=n)

    return make


def hovering(worlds: BatchEnvironment, steps: int, field: str, truth: Callable[[], np.ndarray]) -> np.ndarray:
    """(steps, n, k) errors of an observed field while the robot keeps its place."""
    worlds.reset(100)
    action, errors = hold_actions(worlds), []
    for _ in range(steps):
        errors.append(worlds.step(action).obs[field] - truth())
    return np.array(errors)


@pytest.mark.slow
def test_an_object_is_seen_with_its_declared_bias_and_noise(load: Load) -> None:
    worlds = load("pick_place", DECLARED, n=256)
    view = worlds.simulation.view
    bowl = hovering(worlds, STEPS, "bowl_pos", lambda: view.site_pos("bowl"))
    cube = hovering(worlds, STEPS, "cube_pos", lambda: view.site_pos("cube"))
    assert (bowl - bowl.mean(0)).std() == pytest.approx(DECLARED.position_noise, rel=0.1)
    constant = np.hypot(DECLARED.frame_bias, DECLARED.position_bias)
    assert bowl.mean(0).std() == pytest.approx(constant, rel=0.1)
    assert abs(bowl.mean()) < 0.1 * constant, "errors favour no side"
    common = (bowl.mean(0) * cube.mean(0)).mean()
    assert common == pytest.approx(DECLARED.frame_bias**2, rel=0.3), "objects share what the frame is off"
    wander = bowl - bowl.mean(0)
    later = round(DECLARED.time / worlds.spec.control_dt_s)
    assert (wander[later:] * wander[:-later]).mean() / wander.var() == pytest.approx(np.exp(-1.0), abs=0.1)


def test_an_object_is_seen_turned_as_declared(load: Load) -> None:
    worlds = load("press_button", DECLARED, n=256)
    obs = worlds.reset(0)
    seen = mat_from_rot6d(obs["button_rot6d"])
    true = worlds.simulation.view.site_mat("button").reshape(-1, 3, 3)
    turn = np.einsum("nij,nkj->nik", seen, true)
    angles = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]
    )
    assert angles.std() == pytest.approx(np.hypot(DECLARED.angle_bias, DECLARED.angle_noise), rel=0.1)
    np.testing.assert_allclose(np.einsum("nij,nik->njk", seen, seen), np.tile(np.eye(3), (256, 1, 1)), atol=1e-12)


def test_a_joints_speed_errs_as_its_position_wanders(load: Load) -> None:
    worlds = load("open_door", DECLARED, n=256)
    rates = hovering(worlds, 50, "door_rate", lambda: worlds.simulation.view.joint("door")[1][:, None])
    assert rates.std() == pytest.approx(DECLARED.angle_noise / DECLARED.time, rel=0.1)
    angles = hovering(worlds, 50, "door_angle", lambda: worlds.simulation.view.joint("door")[0][:, None])
    assert angles.std() == pytest.approx(np.hypot(DECLARED.angle_bias, DECLARED.angle_noise), rel=0.1)


VELOCITIES = pytest.mark.parametrize(("task", "body"), [("toss_ball", "ball"), ("carry_slung_load", "load")])


@VELOCITIES
def test_a_free_bodys_velocity_is_seen_as_many_steps_late_as_declared(load: Load, task: str, body: str) -> None:
    late, exact = (load(task, estimation) for estimation in (replace(NO_ERROR, lag=3), None))
    seen, true = [late.reset(0)[f"{body}_vel"]], [exact.reset(0)[f"{body}_vel"]]
    for view in (late.simulation.view, exact.simulation.view):
        view.qvel[:, view.free_joint(body)[1].start + 2] = 1.5  # m/s: somebody has thrown it up
    for _ in range(8):
        seen.append(late.step(hold_actions(late)).obs[f"{body}_vel"])
        true.append(exact.step(hold_actions(exact)).obs[f"{body}_vel"])
    assert np.ptp(true, axis=0)[:, 2].min() > 0.3
    for step in range(9):
        np.testing.assert_array_equal(seen[step], true[max(step - 3, 0)])


@VELOCITIES
def test_a_free_bodys_velocity_errs_as_its_position_wanders(load: Load, task: str, body: str) -> None:
    worlds = load(task, replace(DECLARED, lag=0), n=128)
    first, view = tasks.get(task).velocities[body], worlds.simulation.view
    wrong = hovering(worlds, 20, f"{body}_vel", lambda: view.task_state[:, first : first + 3])
    assert wrong.std() == pytest.approx(DECLARED.position_noise / DECLARED.time, rel=0.1)
    assert abs(np.corrcoef(wrong.reshape(-1, 3), rowvar=False) - np.eye(3)).max() < 0.15, "each axis by itself"


def test_a_force_sensor_has_its_declared_bias_and_noise(load: Load) -> None:
    worlds = load("push_slider", DECLARED, n=256)
    felt = hovering(worlds, 50, "tool_force", worlds.simulation.view.force)
    assert felt.mean(0).std() == pytest.approx(DECLARED.force_bias, rel=0.1)
    noise = felt - felt.mean(0)
    assert noise.std() == pytest.approx(DECLARED.force_noise, rel=0.1)
    assert abs((noise[1:] * noise[:-1]).mean()) < 0.1 * noise.var(), "one measurement says nothing of the next"


def test_what_is_drawn_has_the_biases(load: Load) -> None:
    worlds = load("pick_place", replace(DECLARED, position_noise=0.0, angle_noise=0.0))
    obs, view = worlds.reset(5), worlds.simulation.view
    for world in range(3):
        drawn = worlds.drawn(5 + world)
        for name in ("cube", "bowl"):
            error = (obs[f"{name}_pos"] - view.site_pos(name))[world]
            biases = np.add(drawn["seen_frame_bias_m"], drawn[f"seen_{name}_bias_m"])
            np.testing.assert_allclose(error, biases, atol=1e-12)


@pytest.mark.parametrize("lag", range(episode_state.MAX_LAG + 1))
def test_objects_are_seen_as_many_steps_late_as_declared(load: Load, lag: int) -> None:
    worlds = load("open_door", replace(NO_ERROR, lag=lag))
    view, seen, true = worlds.simulation.view, [], []
    seen.append(worlds.reset(0))
    view.joint("door")[1][:] = 1.0  # rad/s: somebody has pushed it
    action = hold_actions(worlds)
    for _ in range(12):
        true.append((view.joint("door")[0].copy(), view.site_pos("loop").copy()))
        seen.append(worlds.step(action).obs)
    assert np.ptp([angle for angle, _ in true], axis=0).min() > 0.04
    for step in range(12):
        angle, loop = true[max(step - lag, 0)]
        np.testing.assert_array_equal(seen[step]["door_angle"][:, 0], angle)
        np.testing.assert_allclose(seen[step]["loop_pos"], loop, atol=1e-12)


@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "ua_quad_arm4", "z1"])
def test_base_and_tool_are_seen_as_the_controller_sees_them(robot: str) -> None:
    worlds = aerial_il.load_batch(robot, "pick_place", num_envs=16, tier="hard")
    view, effects = worlds.simulation.view, worlds.simulation.disturbances.table.effects
    obs = worlds.reset(0)
    for action in random_actions(worlds.spec.action, 5, 16):
        obs = worlds.step(action).obs
    if robot == "z1":
        np.testing.assert_array_equal(obs["ee_pos"], view.tool_pos, err_msg="where a fixed base stands is known")
        return
    np.testing.assert_allclose(obs["base_pos"], view.base_pos + effects["position"], atol=1e-12)
    np.testing.assert_allclose(obs["base_vel"], view.base_vel + effects["velocity"], atol=1e-12)
    np.testing.assert_allclose(obs["base_angvel"], view.base_angvel + effects["rate"], atol=1e-12)
    seen, true = mat_from_rot6d(obs["base_rot6d"]), view.base_mat.reshape(-1, 3, 3)
    assert np.abs(seen - true).max() > 1e-4
    arm_seen = np.einsum("nji,nj->ni", seen, obs["ee_pos"] - obs["base_pos"])
    arm_true = np.einsum("nji,nj->ni", true, view.tool_pos - view.base_pos)
    np.testing.assert_allclose(arm_seen, arm_true, atol=1e-12)
    wrist_seen = np.einsum("nji,njk->nik", seen, mat_from_rot6d(obs["ee_rot6d"]))
    wrist_true = np.einsum("nji,njk->nik", true, view.tool_mat.reshape(-1, 3, 3))
    np.testing.assert_allclose(wrist_seen, wrist_true, atol=1e-12)


def test_all_parts_of_an_object_move_as_one(load: Load) -> None:
    worlds = load("open_door", DECLARED, n=16)
    obs, view = worlds.reset(0), worlds.simulation.view
    seen, true = obs["loop_pos"] - obs["hinge_pos"], view.site_pos("loop") - view.site_pos("door")
    assert np.abs(seen - true).max() > 1e-3, "it is turned"
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), np.linalg.norm(true, axis=1), atol=1e-12)


def test_relative_positions_are_those_of_what_is_seen() -> None:
    worlds = aerial_il.load_batch(ROBOT, "pick_place", num_envs=8, tier="hard")
    obs = worlds.reset(0)
    np.testing.assert_allclose(obs["tool_to_cube"], obs["cube_pos"] - obs["ee_pos"], atol=1e-15)
    np.testing.assert_allclose(obs["cube_to_bowl"], obs["bowl_pos"] - obs["cube_pos"], atol=1e-15)


@pytest.mark.parametrize("task", ["reach", "track", "hover"])
def test_what_the_user_gives_is_exact(task: str) -> None:
    robot = "quad" if task == "hover" else ROBOT
    worlds = aerial_il.load_batch(robot, task, num_envs=8, tier="hard")
    worlds.reset(0)
    obs = worlds.step(hold_actions(worlds)).obs
    view = worlds.simulation.view
    np.testing.assert_array_equal(obs["target_pos"], view.mocap_pos[:, view.mocap_id("target")])
    own = "base" if task == "hover" else "ee"
    to_target = obs["base_to_target" if task == "hover" else "tool_to_target"]
    np.testing.assert_allclose(to_target, obs["target_pos"] - obs[f"{own}_pos"], atol=1e-15)
    assert np.abs(obs[f"{own}_pos"] - (view.base_pos if task == "hover" else view.tool_pos)).max() > 1e-3


@pytest.mark.parametrize(("robot", "task"), SAMPLE)
def test_nothing_that_is_seen_is_the_truth(robot: str, task: str) -> None:
    """A field that is read past the estimate would be shown as it is."""
    seen, true = (aerial_il.load_batch(robot, task, num_envs=4, tier=tier) for tier in ("hard", "hard-estimation"))
    shown, exact, about = seen.reset(7), true.reset(7), tasks.get(task)
    same = {name for name in shown if (shown[name] == exact[name]).all(axis=-1).any()}
    assert same >= ENCODERS & set(shown)
    known = {name for name in same if name.startswith(tuple(f"{commanded}_" for commanded in about.commanded))}
    if seen.simulation.robot.fixed:
        known |= {name for name in same if name.startswith("ee_") or name == "tool_to_target"}
    assert same <= ENCODERS | MARKED | COUNTED | known
    assert MARKED & same <= {name for name, _ in about.privileged}


@pytest.mark.parametrize("task", ["pick_place", "insert_peg"])
def test_reward_success_and_expert_stay_with_the_truth(task: str) -> None:
    seen, true = (aerial_il.load_batch(ROBOT, task, num_envs=4, tier=tier) for tier in ("hard", "hard-estimation"))
    experts = [aerial_il.expert(ROBOT, task) for _ in range(2)]
    obs = []
    for worlds, expert in zip((seen, true), experts, strict=True):
        expert.attach(worlds)
        obs.append(worlds.reset(3))
        expert.reset()
    assert not np.array_equal(obs[0]["ee_pos"], obs[1]["ee_pos"])
    for _ in range(300):
        actions = [expert.act(shown) for expert, shown in zip(experts, obs, strict=True)]
        np.testing.assert_array_equal(actions[0], actions[1])
        here, there = seen.step(actions[0]), true.step(actions[1])
        np.testing.assert_array_equal(here.reward, there.reward)
        for name in here.info:
            np.testing.assert_array_equal(here.info[name], there.info[name], err_msg=name)
        obs = [here.obs, there.obs]
    first = mujoco.mj_stateSize(seen.model, STATE_OFFSET)
    of_sight = first + np.r_[episode_state.ERRORS, episode_state.PAST]
    states = [np.delete(worlds.get_state(), of_sight, axis=1) for worlds in (seen, true)]
    np.testing.assert_array_equal(states[0], states[1])


def test_a_state_in_which_nothing_was_late_can_be_continued() -> None:
    exact, worlds = (aerial_il.load_batch(ROBOT, "pick_place", num_envs=3, tier=tier) for tier in ("calm", "hard"))
    exact.reset(0)
    seen = worlds.set_state(exact.get_state())["cube_pos"]
    far = np.linalg.norm(seen - worlds.simulation.view.site_pos("cube"), axis=1)
    assert (far < 0.02).all()
    assert (far > 0.0).all()


def test_a_restored_state_is_seen_as_it_was_where_nothing_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its errors lie behind the layout, and of what stands still no past is kept by which they could be told."""
    monkeypatch.setattr(Reach, "commanded", ())
    monkeypatch.setattr(Reach, "sight", (5, 0))
    worlds = aerial_il.load_batch(ROBOT, "reach", num_envs=2, tier="gusts", num_threads=1)
    shown, state = worlds.reset(0), worlds.get_state()
    again = worlds.set_state(state)
    np.testing.assert_array_equal(again["target_pos"], shown["target_pos"])
    np.testing.assert_array_equal(worlds.get_state(), state)


def test_without_the_component_all_is_exact() -> None:
    for tier in ("calm", "breeze", "hard-estimation"):
        worlds = aerial_il.load_batch(ROBOT, "pick_place", num_envs=2, tier=tier)
        obs, view = worlds.reset(0), worlds.simulation.view
        np.testing.assert_array_equal(obs["cube_pos"], view.site_pos("cube"))
        np.testing.assert_array_equal(obs["ee_pos"], view.tool_pos)
        assert "estimation" not in worlds.spec.disturbances


def test_a_recording_has_the_declared_errors() -> None:
    spec = aerial_il.load_batch(ROBOT, "pick_place", num_envs=1, tier="gusts").spec
    assert spec.disturbances["estimation"] == vars(DECLARED) | {"memory": DECLARED.memory}
    hard = tiers.standard("estimation")
    assert all(getattr(hard, name) > value for name, value in vars(DECLARED).items() if name != "time")


def test_a_task_must_say_what_its_mocap_bodies_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Track, "commanded", ())
    monkeypatch.setattr(Track, "names", Names(mocaps=("target",)))
    with pytest.raises(InvalidValueError, match="reads body target, but no site of the object that it belongs to"):
        aerial_il.load_batch(ROBOT, "track", num_envs=1, tier="gusts")


def test_more_objects_than_the_memory_holds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PickPlace, "sight", (1, 14))
    with pytest.raises(InvalidValueError, match="pick_place shows 2 objects, its `sight` says 1: say as many, 6 at"):
        aerial_il.load_batch(ROBOT, "pick_place", num_envs=1, tier="gusts")
    monkeypatch.setattr(PickPlace, "sight", (4, 6))
    with pytest.raises(InvalidValueError, match="take 7 numbers, and an estimate holds 6"):
        aerial_il.load_batch(ROBOT, "pick_place", num_envs=1, tier="gusts")


def test_a_task_that_shows_more_has_its_memory_behind_the_layout() -> None:
    """What six objects of three that move show is late and wrong by the declared errors, and no two by the same."""
    worlds = aerial_il.load_batch(ROBOT, "sort_pegs", num_envs=200, tier="hard-payload-wind", num_threads=1)
    obs, view = worlds.reset(0), worlds.simulation.view
    assert worlds.model.nuserdata == worlds.simulation.scenario.tier.userdata_size + 6 * 6 + 4 * 21
    names = [f"{what}_{colour}" for what in ("peg", "hole") for colour in ("red", "green", "blue")]
    shown = ["red_peg_pos", "green_peg_pos", "blue_peg_pos", "red_hole_pos", "green_hole_pos", "blue_hole_pos"]
    wrong = np.array([obs[key] - view.site_pos(name) for key, name in zip(shown, names, strict=True)])
    part = tiers.get("hard").parts["estimation"]
    assert isinstance(part, Estimation)
    expected = np.sqrt(part.frame_bias**2 + part.position_bias**2 + part.position_noise**2)
    np.testing.assert_allclose(wrong.std(axis=(1, 2)), expected, rtol=0.15)
    own = wrong - wrong.mean(axis=0)
    assert np.abs(np.corrcoef(own.reshape(6, -1)) + 0.2 - 1.2 * np.eye(6)).max() < 0.15, "each has an error of its own"
    pose, _ = view.free_joint("peg_red")
    hover = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((200, 1))], axis=1)
    view.qpos[:, pose.start + 2] += 0.2
    obs = worlds.step(hover).obs
    assert obs["red_peg_pos"][:, 2].mean() < 0.5, "it is seen where it was"
    for _ in range(part.lag):
        obs = worlds.step(hover).obs
    assert obs["red_peg_pos"][:, 2].mean() > 0.55


def test_a_state_with_more_memory_continues_bit_for_bit() -> None:
    first, second = (aerial_il.load_batch(ROBOT, "restock", num_envs=2, tier="hard") for _ in range(2))
    obs = first.reset(3)
    second.reset(9)
    hover = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((2, 1))], axis=1)
    for _ in range(7):
        first.step(hover)
    second.set_state(first.get_state())
    for _ in range(7):
        one, other = first.step(hover).obs, second.step(hover).obs
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"position_bias": -0.001}, "position_bias is -0.001"),
        ({"time": 0.0}, "time is 0.0"),
        ({"lag": episode_state.MAX_LAG + 1}, f"at most {episode_state.MAX_LAG}"),
    ],
)
def test_wrong_errors_are_refused(wrong: dict[str, float], says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        Estimation(**wrong)  # type: ignore[arg-type]

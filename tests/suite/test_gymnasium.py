"""Both Gymnasium faces keep Gymnasium's promises and agree with each other."""

from __future__ import annotations

import dataclasses
import gc
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

import aerial_il
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite.faces.gymnasium_env import SingleEnv
from aerial_il.suite.faces.gymnasium_ids import gymnasium_id
from aerial_il.suite.faces.gymnasium_vector import VectorEnvironment
from aerial_il.suite.faces.options import SCENARIO, FaceOptions, Presentation, read_options
from aerial_il.suite.scenario import Scenario
from tests.contract.registered import CELLS, each_sample, levels, random_actions
from tests.patience import HANG_S

ROBOT, TASK = "ua_quad_arm4", "pick_place"
ID = gymnasium_id(ROBOT, TASK)
KNOWN_WARNINGS = ("-infinity", "is infinity", "symmetric and normalized")  # SI units; states have no bounds


def make_vector(num_envs: int = 3, **options: object) -> VectorEnvironment:
    env = gymnasium.make_vec(ID, num_envs=num_envs, vectorization_mode="vector_entry_point", **options)
    assert isinstance(env, VectorEnvironment)
    return env


def checked(env: gymnasium.Env) -> None:
    """Run Gymnasium's checker; let only the known warnings pass."""
    gc.collect()  # what other tests left open warns now, not within
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    messages = [str(w.message) for w in caught]
    assert [m for m in messages if not any(known in m for known in KNOWN_WARNINGS)] == []


@each_sample
def test_every_cell_is_registered_and_passes_the_checker(robot: str, task: str) -> None:
    with gymnasium.make(gymnasium_id(robot, task), tier="gusts+latency-noise") as env:
        assert isinstance(env.unwrapped, SingleEnv)
        checked(env)


@pytest.mark.parametrize("level", levels("ua_quad_arm4"))
def test_every_action_level_passes_the_checker(level: str) -> None:
    with gymnasium.make(ID, action=level) as env:
        checked(env)


@pytest.mark.render
def test_cameras_pass_the_checker_and_images_have_their_types() -> None:
    cameras = ["wrist", "scene:depth", "base:segmentation"]
    with gymnasium.make(ID, cameras=cameras, image_size=(24, 32), render_mode="rgb_array") as env:
        checked(env)
        obs, _ = env.reset(seed=0)
        assert {k: (v.dtype.name, v.shape) for k, v in obs.items() if v.ndim >= 2} == {
            "wrist_rgb": ("uint8", (24, 32, 3)),
            "scene_depth": ("float32", (24, 32)),
            "base_segmentation": ("int32", (24, 32)),
        }
        assert env.render().shape == (240, 320, 3)


@pytest.mark.parametrize(
    "program",
    [
        "import aerial_il, gymnasium as g; g.spec('{id}')",
        "import gymnasium as g, aerial_il; g.spec('{id}')",
        "import gymnasium as g; g.make('aerial_il:{id}').close()",
        "import aerial_il, sys; assert not {{'gymnasium', 'mujoco', 'numpy', 'numba'}} & set(sys.modules)",
    ],
)
def test_ids_are_there_in_either_order_and_importing_stays_light(program: str) -> None:
    subprocess.run([sys.executable, "-c", program.format(id=ID)], check=True, timeout=HANG_S)


def test_a_seed_is_the_episodes_and_the_next_ones_follow() -> None:
    with gymnasium.make(ID) as env:
        ours = aerial_il.load(ROBOT, TASK)
        obs, info = env.reset(seed=12)
        assert info["seed"] == 12
        for name, value in ours.reset(seed=12).observation.items():
            np.testing.assert_array_equal(obs[name], value)
        assert env.reset()[1]["seed"] == 13


def test_float32_actions_are_taken() -> None:
    with gymnasium.make(ID) as env:
        obs, _ = env.reset(seed=1)
        action = np.concatenate([obs["ee_pos"], obs["ee_rot6d"], [1.0]]).astype(np.float32)
        assert action in env.action_space
        _, reward, terminated, truncated, info = env.step(action)
        assert isinstance(reward, float)
        assert (terminated, truncated) == (False, False)
        assert info["subtasks"].shape == (len(env.unwrapped.aerial.spec.subtasks),)


def solve(env: gymnasium.Env, seed: int) -> tuple[int, bool, dict]:
    """Fly the expert; return the steps flown, whether the environment ended the episode, and the last info."""
    expert = aerial_il.expert(ROBOT, "reach")
    expert.attach(env.unwrapped.aerial)
    env.reset(seed=seed)
    expert.reset()
    steps, ended, info = 0, False, {"success": False}
    while not (ended or info["success"]):
        _, _, terminated, truncated, info = env.step(expert.act({})[0])
        steps, ended = steps + 1, terminated or truncated
    return steps, ended, info


def test_success_ends_an_episode_only_on_request() -> None:
    reach = gymnasium_id(ROBOT, "reach")
    with gymnasium.make(reach) as env:
        steps, ended, info = solve(env, 3)
        assert info["success"]
        assert info["is_success"]
        assert not ended
    with gymnasium.make(reach, terminate_on_success=True) as env:
        assert solve(env, 3)[:2] == (steps, True)
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(env.action_space.sample())


def test_no_step_without_a_reset() -> None:
    env = SingleEnv(ROBOT, TASK)
    with pytest.raises(gymnasium.error.ResetNeeded, match="No episode is running"):
        env.step(np.zeros(10))
    env.close()


def test_names_and_modes_are_checked() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'gusts'"):
        gymnasium.make(ID, tier="gust")
    with pytest.raises(UnknownNameError, match="camera"):
        SingleEnv(ROBOT, TASK, render_camera="moon")
    with pytest.raises(InvalidValueError, match="render_mode"):
        VectorEnvironment(ROBOT, TASK, render_mode="human")


@pytest.mark.parametrize("make", [gymnasium.make, make_vector])
def test_an_unknown_option_is_answered_with_the_nearest(make: Callable[..., Any]) -> None:
    with pytest.raises(UnknownNameError, match=r"Unknown option 'teir'. Did you mean 'tier'"):
        make(*([ID] if make is gymnasium.make else []), teir="gusts")


def test_defaults_of_the_faces_are_those_of_the_scenario() -> None:
    scenario, shown = read_options(ROBOT, TASK, {})
    assert (scenario, shown) == (Scenario(ROBOT, TASK), Presentation())
    fields = {field.name for part in (Scenario, Presentation) for field in dataclasses.fields(part)}
    assert {SCENARIO.get(name, name) for name in FaceOptions.__annotations__} == fields - {
        "robot_name",
        "task_name",
        "horizon",  # only a batch's: a face ends an episode where Gymnasium's wrappers say
    }


@pytest.fixture(scope="module")
def vector() -> Iterator[VectorEnvironment]:
    env = make_vector(tier="gusts", max_episode_steps=6)
    yield env
    env.close()


def test_the_vector_environment_has_batched_spaces(vector: VectorEnvironment) -> None:
    assert isinstance(vector, VectorEnv)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert vector.action_space.shape == (3, 10)
    obs, info = vector.reset(seed=0)
    assert obs in vector.observation_space
    for i in range(3):
        assert {name: value[i] for name, value in obs.items()} in vector.single_observation_space
    assert info["_success"].all()
    assert not info["_ee_error_m"].any(), "nothing has been commanded yet"
    obs, reward, terminated, truncated, info = vector.step(vector.action_space.sample())
    assert obs in vector.observation_space
    assert reward.shape == terminated.shape == truncated.shape == (3,)
    assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float64, np.bool_, np.bool_)
    assert info["_ee_error_m"].all()


def test_it_answers_as_gymnasiums_own_vector(vector: VectorEnvironment) -> None:
    ours = vector
    singles = SyncVectorEnv([lambda: gymnasium.make(ID, tier="gusts", max_episode_steps=6)] * 3)
    assert singles.single_action_space == ours.single_action_space
    assert singles.single_observation_space == ours.single_observation_space
    first, _ = ours.reset(seed=8)
    assert data_equivalence(dict(first), dict(singles.reset(seed=8)[0]), exact=True)
    for k, actions in enumerate(random_actions(ours.aerial.spec.action, 7, 3)):
        mine, theirs = ours.step(actions), singles.step(actions)
        for a, b in zip(mine[1:4], theirs[1:4], strict=True):
            np.testing.assert_array_equal(a, b)
        if k == 6:  # the next episodes: seeds differ, the form does not
            break
        assert data_equivalence(dict(mine[0]), dict(theirs[0]), exact=True)
        for name in set(theirs[4]) - {"ee_error_m"}:
            np.testing.assert_array_equal(mine[4][name], theirs[4][name], err_msg=name)
    assert mine[4].keys() >= theirs[4].keys() - {"ee_error_m", "_ee_error_m"}
    singles.close()


def test_an_ended_world_starts_again_at_the_next_step(vector: VectorEnvironment) -> None:
    vector.reset(seed=20)
    _, info = vector.reset(seed=[20, 21, 50], options={"reset_mask": np.array([False, False, True])})
    assert info["seed"].tolist() == [20, 21, 50]
    assert info["_seed"].tolist() == [False, False, True]
    hover = vector.action_space.sample()
    for _ in range(6):
        obs, _, _, truncated, info = vector.step(hover)
    assert truncated.all()
    assert info["seed"].tolist() == [20, 21, 50], "the last observation is that of the episode that ended"
    last = {name: value.copy() for name, value in obs.items()}
    obs, reward, terminated, truncated, info = vector.step(np.full((3, 10), np.nan))  # ignored
    assert info["seed"].tolist() == [23, 24, 53]
    assert not np.stack([reward, terminated, truncated]).any()
    assert not np.array_equal(obs["base_pos"], last["base_pos"])
    fresh = aerial_il.load(ROBOT, TASK, tier="gusts").reset(seed=24).observation
    np.testing.assert_array_equal(obs["cube_pos"][1], fresh["cube_pos"])


def test_an_ended_world_may_start_again_in_the_same_step() -> None:
    options = {"tier": "gusts", "max_episode_steps": 3}
    ours = make_vector(autoreset_mode="SAME_STEP", **options)
    makers = [lambda: gymnasium.make(ID, **options)] * 3
    singles = SyncVectorEnv(makers, autoreset_mode=AutoresetMode.SAME_STEP)
    assert ours.autoreset_mode is ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    ours.reset(seed=8), singles.reset(seed=8)
    for actions in random_actions(ours.aerial.spec.action, 3, 3):
        mine, theirs = ours.step(actions), singles.step(actions)
    assert mine[3].all()
    assert theirs[3].all()
    np.testing.assert_array_equal(mine[4]["_final_obs"], theirs[4]["_final_obs"])
    for one, other in zip(mine[4]["final_obs"], theirs[4]["final_obs"], strict=True):
        assert data_equivalence(one, dict(other), exact=True)
    for name in set(theirs[4]["final_info"]):
        np.testing.assert_array_equal(mine[4]["final_info"][name], theirs[4]["final_info"][name], err_msg=name)
    assert mine[4]["seed"].tolist() == [11, 12, 13], "the next episodes, as they begin"
    fresh = aerial_il.load(ROBOT, TASK, tier="gusts").reset(seed=12).observation
    np.testing.assert_array_equal(mine[0]["cube_pos"][1], fresh["cube_pos"])
    after = ours.step(ours.action_space.sample())
    assert not after[3].any()
    assert "final_obs" not in after[4]
    ours.close(), singles.close()


def test_worlds_that_are_over_may_wait_for_their_reset() -> None:
    env = make_vector(2, max_episode_steps=1, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[0, 1\]"):
        env.step(env.action_space.sample())
    env.reset(options={"reset_mask": np.array([True, True])})
    env.step(env.action_space.sample())
    with pytest.raises(UnknownNameError, match="SAME_STEP"):
        make_vector(2, autoreset_mode="later")
    env.close()


def test_seeds_come_as_one_number_or_as_many_as_worlds(vector: VectorEnvironment) -> None:
    assert vector.reset(seed=np.int64(4))[1]["seed"].tolist() == [4, 5, 6]
    assert vector.reset(seed=[9, 1, 5])[1]["seed"].tolist() == [9, 1, 5]
    with pytest.raises(InvalidValueError, match="one entry per world"):
        vector.reset(seed=[1, 2])
    with pytest.raises(gymnasium.error.Error, match="greater or equal to zero"):
        vector.reset(seed=-1)


@pytest.mark.render
def test_the_vector_environment_renders_all_worlds() -> None:
    env = make_vector(2, render_mode="rgb_array", render_size=(24, 32))
    env.reset(seed=0)
    frames = env.render()
    assert [frame.shape for frame in frames] == [(24, 32, 3)] * 2
    assert not np.array_equal(*frames)
    env.close()


def test_specifications_can_be_sent_to_another_process() -> None:
    spec = pickle.loads(pickle.dumps(gymnasium.spec(ID)))
    assert gymnasium.make(spec).unwrapped.aerial.spec.robot == ROBOT
    assert set(gymnasium.registry) >= {gymnasium_id(*cell) for cell in CELLS}


def test_asking_whether_it_is_installed_takes_nothing_away() -> None:
    asked = "import importlib.util, aerial_il; importlib.util.find_spec('gymnasium'); import gymnasium"
    counted = "print(sum(name.startswith('aerial_il/') for name in gymnasium.registry))"
    done = subprocess.run([sys.executable, "-c", f"{asked}; {counted}"], capture_output=True, text=True, check=True)
    assert int(done.stdout) >= len(CELLS)

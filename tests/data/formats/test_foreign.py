"""What others recorded opens, trains with the shipped defaults and is evaluated where an environment is named."""

import json
from pathlib import Path

import gymnasium
import h5py
import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import open_dataset
from experiments.foreign import layouts

EPISODES, STEPS = 3, 30
ENV = "Pendulum-v1"
SMALL = ["algorithm.steps=2", "policy.hidden=[8]", "progress=false"]


@pytest.fixture(scope="module")
def flown() -> dict[str, np.ndarray]:
    """Transitions that a script writes down, of an environment that ends by its time limit."""
    env, rows = gymnasium.make(ENV, max_episode_steps=STEPS), []
    for seed in range(EPISODES):
        obs, over = env.reset(seed=seed)[0], False
        env.action_space.seed(seed)
        while not over:
            action = env.action_space.sample()
            after, reward, terminated, over, _ = env.step(action)
            rows.append((obs, action, after, reward, terminated, over))
            obs = after
    names = ("obs", "acts", "next_obs", "rews", "dones", "truncations")
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


def npz(home: Path, flown: dict[str, np.ndarray]) -> Path:
    return layouts.npz(home / "rollouts.npz", flown)


def d4rl(home: Path, flown: dict[str, np.ndarray]) -> Path:
    names = {
        "observations": "obs",
        "actions": "acts",
        "rewards": "rews",
        "terminals": "dones",
        "timeouts": "truncations",
    }
    columns = {theirs: flown[name] for theirs, name in names.items()}
    return layouts.d4rl(home / "d4rl.hdf5", {**columns, "infos/qpos": np.zeros((EPISODES * STEPS, 2))})


def robomimic(home: Path, flown: dict[str, np.ndarray]) -> Path:
    """As robomimic's own scripts write: actions of one demonstration reach further than those of another."""
    demos = [
        {
            "actions": flown["acts"][part],
            "rewards": np.zeros(STEPS - i),
            "obs": {"observation": flown["obs"][part]},
            "next_obs": {"observation": flown["next_obs"][part]},
            "dones": np.zeros(STEPS - i, int),
        }
        for i, part in enumerate(slice(k * STEPS, (k + 1) * STEPS - k) for k in range(EPISODES))  # of different lengths
    ]
    env = {"env_name": ENV, "type": 2, "env_kwargs": {"control_freq": 20}}
    return layouts.robomimic(home / "low_dim.hdf5", *demos, env=env)


def mimicgen(home: Path, flown: dict[str, np.ndarray]) -> Path:
    """As ``write_demo_to_hdf5`` and ``merge_all_hdf5`` of MimicGen 1.0.1 write what it generated.

    robomimic's layout without rewards, ends and following observations, and in each demonstration how it came about.
    """
    with h5py.File(home / "demo.hdf5", "w") as file:
        data = file.create_group("data")
        for i in range(EPISODES):
            steps = STEPS - i
            part = slice(i * STEPS, i * STEPS + steps)
            demo, poses = data.create_group(f"demo_{i}"), np.tile(np.eye(4), (steps, 1, 1))
            demo["actions"], demo["states"] = flown["acts"][part], np.zeros((steps, 7))
            demo.create_dataset("obs/observation", data=flown["obs"][part], compression="gzip")
            told = demo.create_group("datagen_info")
            told["eef_pose"] = told["target_pose"] = told["object_poses/cube"] = poses
            told["gripper_action"], told["subtask_term_signals/grasp"] = np.zeros((steps, 1)), np.zeros(steps, int)
            demo["src_demo_inds"], demo["src_demo_labels"] = np.zeros(2, int), np.zeros((steps, 1), int)
            demo.attrs["model_file"], demo.attrs["num_samples"] = "<mujoco/>", steps
        data.attrs["total"] = sum(STEPS - i for i in range(EPISODES))
        data.attrs["env_args"] = json.dumps({"env_name": ENV, "type": 2, "env_kwargs": {}}, indent=4)
    return home / "demo.hdf5"


FORMS = {"npz": npz, "d4rl": d4rl, "robomimic": robomimic, "mimicgen": mimicgen}
ROBOMIMIC = ("robomimic", "mimicgen")


@pytest.mark.parametrize("form", FORMS)
def test_it_opens_with_every_value(form: str, flown: dict[str, np.ndarray], tmp_path: Path) -> None:
    dataset = open_dataset(FORMS[form](tmp_path, flown))
    assert len(dataset) == EPISODES
    first = dataset[0]
    np.testing.assert_array_equal(first.actions, flown["acts"][:STEPS])
    np.testing.assert_array_equal(first.obs["observation"][:-1], flown["obs"][:STEPS])
    assert all(not first.spec.differences(episode.spec) for episode in dataset), "one environment for all"
    if form not in ("d4rl", "mimicgen"):  # which have no observation after the last action
        np.testing.assert_array_equal(first.obs["observation"][-1], flown["next_obs"][STEPS - 1])
    if form not in ROBOMIMIC:
        assert [bool(e.truncated[-1]) for e in dataset] == [True] * EPISODES
        np.testing.assert_allclose(first.rewards, flown["rews"][:STEPS])


@pytest.mark.parametrize("form", FORMS)
def test_it_trains_by_default_and_flies_where_it_names_a_world(
    form: str, flown: dict[str, np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = FORMS[form](tmp_path, flown)
    assert main(["train", f"dataset={file}", "run=run", *SMALL]) == 0
    where = [] if form in ROBOMIMIC else [f"env=gymnasium:{ENV}"]  # its file tells
    judged = ["episodes=2", "videos=0", "out=judged", "success=survived", "progress=false"]
    assert main(["evaluate", "policy=run", *where, "max_steps=10", *judged]) == 0
    assert aerial_il.load_policy("run").spec.action.size == 1


def test_what_a_robomimic_file_tells_is_used(flown: dict[str, np.ndarray], tmp_path: Path) -> None:
    spec = open_dataset(robomimic(tmp_path, flown)).spec
    assert (spec.robot, spec.task, spec.control_dt_s, spec.max_steps) == ("gymnasium", ENV, 0.05, STEPS)
    low, high = flown["acts"][: (EPISODES - 1) * STEPS].min(), flown["acts"].max()
    assert spec.action.low[0] <= low
    assert spec.action.high[0] <= high + 1e-5


def test_no_reward_is_a_failure_only_where_others_have_one(flown: dict[str, np.ndarray], tmp_path: Path) -> None:
    file = robomimic(tmp_path, flown)
    assert [episode.success for episode in open_dataset(file)] == [True] * EPISODES
    with h5py.File(file, "a") as raw:
        raw["data/demo_1/rewards"][-1] = 1.0
    assert [episode.success for episode in open_dataset(file)] == [False, True, False]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"acts": None}, "lacks actions or acts"),
        ({"obs": np.zeros((5, 3))}, "of another length"),
        ({"obs": np.full((EPISODES * STEPS, 3), np.nan)}, "not finite"),
        ({"acts": np.zeros((EPISODES * STEPS, 1, 2, 2))}, "not vectors of numbers"),
        ({"acts": np.array(["a"] * EPISODES * STEPS)}, "not vectors of numbers"),
    ],
)
def test_what_is_no_transitions_is_refused(
    changed: dict[str, np.ndarray | None], said: str, flown: dict[str, np.ndarray], tmp_path: Path
) -> None:
    arrays = {name: values for name, values in {**flown, **changed}.items() if values is not None}
    with pytest.raises(DemoError, match=said):
        open_dataset(npz(tmp_path, arrays))


def test_an_episode_of_one_step_opens(tmp_path: Path) -> None:
    one = {"observations": np.zeros((1, 3)), "next_observations": np.ones((1, 3)), "actions": np.zeros((1, 2))}
    np.savez(tmp_path / "one.npz", truncations=np.ones(1, bool), timestamps=np.zeros(1), **one)
    assert len(open_dataset(tmp_path / "one.npz")) == 1

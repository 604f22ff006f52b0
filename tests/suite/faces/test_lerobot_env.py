"""lerobot knows our environments, by either road, and sees in them what our datasets have."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.data.formats.parts.lerobot.writing import features_of

ROOT = Path(__file__).resolve().parents[2]
ROBOT, TASK = "fa_hexa_arm4", "reach"


def test_features_are_those_of_the_dataset() -> None:
    from lerobot.envs.utils import env_to_policy_features

    from aerial_il.suite.faces.lerobot.env import AerialEnvConfig

    config = AerialEnvConfig(robot=ROBOT, task=TASK, cameras=["wrist"], image_height=32, image_width=48)
    spec = aerial_il.load(ROBOT, TASK, cameras=["wrist"], image_size=(32, 48)).spec
    dataset = features_of(spec, ["wrist_rgb"])
    shapes = {name: feature.shape for name, feature in env_to_policy_features(config).items()}
    assert shapes.pop("observation.images.wrist") == (3, 32, 48)
    assert shapes == {name: tuple(dataset[name]["shape"]) for name in shapes}
    assert set(shapes) == {"observation.state", "observation.environment_state", "action"}
    assert config.fps == 50


def test_worlds_are_ours_seed_by_seed_and_end_at_success() -> None:
    """Our expert's actions, flown through lerobot's vector environment, succeed where and when they do in the batch."""
    from aerial_il.suite.faces.lerobot.env import AerialEnvConfig

    env = aerial_il.load_batch(ROBOT, TASK, num_envs=2)
    vector = AerialEnvConfig(robot=ROBOT, task=TASK).create_envs(2)["aerial_il"][0]
    try:
        expert = aerial_il.expert(ROBOT, TASK)
        expert.attach(env)
        obs, (seen, _) = env.reset(np.array([7, 8])), vector.reset(seed=[7, 8])
        expert.reset()
        assert vector.call("_max_episode_steps")[0] == env.spec.max_steps
        assert vector.call("task_description")[0] == env.spec.instruction
        for _ in range(env.spec.max_steps):
            state = env.spec.observation.flatten(obs, [f.name for f in env.spec.observation.of_group("proprio")])
            np.testing.assert_array_equal(seen["agent_pos"], state)
            actions = expert.act(obs)
            result = env.step(actions)
            seen, _, terminated, _, info = vector.step(actions)
            np.testing.assert_array_equal(terminated, result.info["success"])
            if terminated.any():
                assert info["final_info"]["is_success"][terminated].all()
                return
            obs = result.obs
        pytest.fail("the expert never succeeded")
    finally:
        vector.close()
        env.close()


@pytest.mark.slow
def test_an_installed_plugin_is_imported_because_of_its_name(tmp_path: Path) -> None:
    info = tmp_path / "lerobot_env_aerial_il-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lerobot_env_aerial_il\nVersion: 0.1.0\n")
    program = (
        f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT / 'plugins' / 'lerobot_env_aerial_il')!r}]\n"
        "from lerobot.utils.import_utils import register_third_party_plugins as find\n"
        "from lerobot.envs.configs import EnvConfig\n"
        "find(); print('aerial_il' in EnvConfig.get_known_choices())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip().endswith("True")


@pytest.mark.slow
def test_lerobot_trains_and_both_evaluators_fly_it(tmp_path: Path) -> None:
    from experiments.lerobot.study import Lerobot

    bench = Lerobot(demos=2, steps=2, batch_size=4, chunk=4, width=16, workers=0, episodes=2, num_envs=2, threads=1)
    report = bench.run(tmp_path, progress=False)
    theirs, ours = report.tables["Success by evaluator"]
    assert (theirs["episodes"], ours["episodes"]) == (2, 2)
    assert theirs["success"] == ours["success"]
    before = (tmp_path / "lerobot_eval" / "eval_info.json").stat().st_mtime_ns
    again = bench.run(tmp_path, progress=False)
    assert (tmp_path / "lerobot_eval" / "eval_info.json").stat().st_mtime_ns == before
    assert again.tables == report.tables
    json.dumps(report.to_dict(), allow_nan=False)

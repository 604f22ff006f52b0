"""The package's front: settings of the commands, threads, cameras, learned rewards, and what is returned."""

import inspect
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.algorithms.dac import DAC
from aerial_il.algorithms.sac import SAC
from aerial_il.cli import commands
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.composition import build
from aerial_il.core.errors import AerialError, InvalidValueError, UnknownNameError
from aerial_il.data.recording.writer import write_episode
from aerial_il.evaluation.baselines import Random
from aerial_il.evaluation.training_run import read_run
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from aerial_il.presentation import analysis
from aerial_il.suite import outside
from aerial_il.workflows.parts import pilots, run_results, training_resources
from aerial_il.workflows.parts.demonstrations import warn_of_changes
from aerial_il.workflows.parts.pilots import pilot
from tests.algorithms.drift import MAX_STEPS, Drift, demonstrations

QUIET = {"progress": False}


def test_a_choice_is_settings_a_name_or_a_mapping(tmp_path: Path) -> None:
    where = {"env": "gymnasium:Pendulum-v1", "max_steps": 5, "num_envs": 2, **QUIET}
    small = {"steps": 4, "warmup": 2, "replay": {"capacity": 100, "batch_size": 2}}
    settings = build(SAC, small)
    weights = []
    for number, algorithm in enumerate((settings, {"name": "sac", **small})):
        for policy in (SquashedGaussian(hidden=(8,)), {"name": "squashed_gaussian", "hidden": [8]}):
            run = tmp_path / f"{number}{type(policy).__name__}"
            weights.append(aerial_il.train(run=run, algorithm=algorithm, policy=policy, **where).to_checkpoint().arrays)
    assert all(np.array_equal(one[name], weights[0][name], equal_nan=True) for one in weights for name in one)
    with pytest.raises(UnknownNameError, match="Did you mean 'sac'"):
        aerial_il.train(run=tmp_path / "no", algorithm="sacs", **where)


def test_the_whole_path_in_three_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cart = {"env": "gymnasium:CartPole-v1", "success": "survived", "max_steps": 5}
    demos = aerial_il.collect(out="demos, of 车", policy="random", episodes=6, num_envs=2, **cart, **QUIET)
    network = {"hidden": [8], "chunk": 1, "ensemble": None}
    policy = aerial_il.train("demos, of 车", run=Path("run"), policy=network, algorithm={"steps": 3}, **QUIET)
    result = aerial_il.evaluate("run", out="judged", episodes=3, videos=0, **QUIET)
    assert len(demos) + len(list(Path("demos, of 车/failures").glob("*.mcap"))) == 6
    assert policy.origin["step"] == 3
    assert [episode.seed for episode in result.episodes] == [10000, 10001, 10002]
    assert "Next:" not in capsys.readouterr().out


@pytest.mark.slow
def test_an_environment_of_this_process_alone_is_flown(tmp_path: Path) -> None:
    gymnasium.register("Known-here-v0", "gymnasium.envs.classic_control.cartpole:CartPoleEnv", max_episode_steps=9)
    ppo = {"name": "ppo", "steps": 64, "rollout": 32, "log_every": 32}
    where = {"env": "gymnasium:Known-here-v0", "success": "survived", "threads": 1, "num_envs": 8}
    judged = {"evaluate_every": 32, "evaluate_episodes": 16}
    aerial_il.train(run=tmp_path / "run", policy="categorical", algorithm=ppo, **where, **judged, **QUIET)
    assert len(analysis.metrics(tmp_path / "run")["evaluate/success"].dropna()) == 2


def test_mistakes_are_answered_as_on_the_command_line(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'episodes'"):
        aerial_il.collect("quad", "hover", out=tmp_path / "d", episods=3)
    with pytest.raises(AerialError, match="episodes=0 is too small"):
        aerial_il.collect("quad", "hover", out=tmp_path / "d", episodes=0)
    with pytest.raises(AerialError, match="does not exist"):
        aerial_il.train(tmp_path / "nowhere", run=tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["collect", "train", "evaluate"])
def test_every_named_argument_is_a_setting(name: str) -> None:
    settings = set(commands.find(name).settings.__dataclass_fields__)
    named = {p.name for p in inspect.signature(getattr(aerial_il, name)).parameters.values() if p.kind != p.VAR_KEYWORD}
    assert named - {"from_run"} <= settings, "from is a word of Python's own"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Among how many processes worlds were asked to be shared; they are made in one."""
    found: list[int] = []
    load = outside.load

    def noted(key: str, *, processes: int = 1, **options: Any) -> Any:
        found.append(processes)
        return load(key, **options)

    monkeypatch.setattr(outside, "load", noted)
    return found


def test_of_a_pilot(asked: list[int]) -> None:
    pilot = pilots.pilot("random", robot=None, task=None, action=None, env="gymnasium:Pendulum-v1")
    for threads, num_envs in ((2, 16), (2, 15), (1, 16)):
        pilot.environment("calm", num_envs=num_envs, threads=threads).close()
    assert asked == [2, 1, 1]


def test_of_a_training_that_flies(asked: list[int], tmp_path: Path) -> None:
    env = aerial_il.load_gymnasium("Pendulum-v1", num_envs=1, max_steps=5)
    collect(env, Random(), range(1), tmp_path, policy_name="random", settings={}, progress=False)
    asked.clear()
    where = {"images": (), "expert": None, "tier": None, "num_envs": 24, "threads": 3}
    with training_resources.training_resources(DAC(), str(tmp_path), **where) as handed:
        assert handed["env"].num_envs == 24
    assert asked == [3]


CELL = ["robot=ua_quad_arm4", "task=reach"]
SEES = ["policy.images=[wrist_rgb,base_rgb]", "policy.obs_names=[ee_pos,ee_rot6d]", "policy.image_features=8"]
SHORT = ["algorithm.steps=2", "algorithm.batch_size=4", "progress=false"]


@pytest.mark.render
def test_a_policy_flies_through_the_cameras_it_learned_from(tmp_path: Path) -> None:
    data, folder = tmp_path / "seen", tmp_path / "run"
    pictures = ["cameras=[wrist,base]", "image_size=[20,24]", "episodes=2", "progress=false"]
    assert main(["collect", *CELL, *pictures, f"out={data}"]) == 0
    assert main(["train", f"dataset={data}", *SEES, *SHORT, f"run={folder}"]) == 0
    flown = pilot(str(folder), robot=None, task=None, action=None)
    assert flown.reference.cameras == ("wrist@20x24", "base@20x24")
    env = flown.environment("calm", num_envs=2, threads=1)
    try:
        flown.policy.attach(env)
        assert flown.policy.act(env.reset(10_000)).shape == (2, env.spec.action.size)
    finally:
        env.close()
    wrong = pilot("hover", robot="ua_quad_arm4", task="reach", action=None).environment("calm", num_envs=1, threads=1)
    with pytest.raises(InvalidValueError, match="sees wrist_rgb 20 x 24, base_rgb 20 x 24; the environment shows no"):
        flown.policy.attach(wrong)
    wrong.close()


def test_the_reward_is_paid_along_the_first_demonstration(tmp_path: Path) -> None:
    demos, folder = demonstrations(2), tmp_path / "run"
    small = {"steps": 64, "warmup": 32, "bc_pretrain_steps": 0, "bc_weight": 0.0}
    nets = {"replay": {"batch_size": 8}, "critics": {"hidden": [8]}, "reward": {"hidden": [8]}}
    settings = build(DAC, {**small, **nets})
    policy = SquashedGaussian(hidden=(8,))
    settings.train(demos, policy, env=Drift(4), run=folder, progress=False)
    run, recorded = read_run(folder), tmp_path / "demo.mcap"
    write_episode(demos[0], recorded)
    ((_, paid),) = run_results.rewarded(run, str(recorded)).items()
    assert {label: values.shape for label, values in paid.items()} == {
        "as flown": (MAX_STEPS,),
        "actions shuffled": (MAX_STEPS,),
    }
    assert run_results.rewarded(run, None) == {}, "no dataset is at hand"
    assert run_results.rewarded(run, str(tmp_path / "nowhere")) == {}
    (folder / "reward").rename(tmp_path / "elsewhere")
    assert run_results.rewarded(run, str(recorded)) == {}, "nothing was learned"


def test_datasets_are_made_of_others(tmp_path: Path) -> None:
    one = aerial_il.collect("fa_hexa_arm4", "press_button", episodes=1, expert={"noise": 0.0}, out=tmp_path / "one")
    assert len(one) == 1
    calm = aerial_il.generate(tmp_path / "one", episodes=3, out=tmp_path / "calm", progress=False)
    gusts = aerial_il.generate(tmp_path / "one", episodes=2, tier="gusts", out=tmp_path / "gusts", progress=False)
    both = aerial_il.merge(tmp_path / "calm", tmp_path / "gusts", out=tmp_path / "both", mix=True, progress=False)
    assert sorted(both.uids) == sorted([*calm.uids, *gusts.uids])
    kept = aerial_il.filter(tmp_path / "both", "tier == 'gusts'", out=tmp_path / "kept", progress=False)
    assert sorted(kept.uids) == sorted(gusts.uids)
    parts = aerial_il.split(tmp_path / "both", parts=["a=0.6", "b=0.4"], out=tmp_path / "parts", progress=False)
    assert {name: len(part) for name, part in parts.items()} == {"a": 3, "b": 2}


@pytest.mark.render
def test_cameras_that_have_moved_since_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "seen"
    pictures = ["cameras=[wrist]", "image_size=[20,24]", "episodes=1", "progress=false"]
    assert main(["collect", *CELL, *pictures, f"out={data}"]) == 0
    warn_of_changes(str(data))
    assert "other cameras" not in capsys.readouterr().err
    robot = robots.get("ua_quad_arm4")
    wider = tuple(replace(camera, fov=120.0) for camera in robot.mounted_cameras)
    monkeypatch.setattr(robots, "get", lambda name: replace(robot, cameras=wider))
    warn_of_changes(str(data))
    assert "other cameras than ua_quad_arm4 has today (wrist: fov 90, now 120)" in capsys.readouterr().err

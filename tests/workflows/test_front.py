"""The package's front: the settings of the commands, the same errors, and what was made is returned."""

from __future__ import annotations

import inspect
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.sac import SAC
from aerial_il.cli import commands
from aerial_il.core.composition import build
from aerial_il.core.errors import AerialError, UnknownNameError
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from aerial_il.presentation import analysis

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
    assert named <= settings

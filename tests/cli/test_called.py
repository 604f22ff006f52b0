"""Commands called from Python: the same keys, the same errors, and what they made is returned."""

from __future__ import annotations

import inspect
from pathlib import Path

import gymnasium
import pytest

import aerial_il
from aerial_il.cli import commands
from aerial_il.cli.called import _typed
from aerial_il.core.errors import AerialError, UnknownNameError
from aerial_il.presentation import analysis
from tests.cli.next_lines import next_commands

QUIET = {"progress": False}


def words(**settings: object) -> list[str]:
    return [word for key, value in settings.items() for word in _typed(key, value)]


def test_values_are_said_in_words() -> None:
    assert words(tier="gusts", episodes=3, cameras=["wrist"], lerobot=True, env=None) == [
        "tier=gusts", "episodes=3", "cameras=[wrist]", "lerobot=true",
    ]  # fmt: skip
    assert words(policy={"name": "act", "chunk": 20, "anchor": None}) == [
        "policy=act",
        "policy.chunk=20",
        "policy.anchor=null",
    ]
    assert words(dataset=Path("all"), algorithm={"training": {"steps": 5}}) == [
        "dataset=./all", "algorithm.training.steps=5",
    ]  # fmt: skip
    assert words(algorithm={"training": {"steps": 5, "lr": 0.1}}) == [
        "algorithm.training.steps=5",
        "algorithm.training.lr=0.1",
    ]


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
    assert [type(command).__module__.split(".")[-1] for command in next_commands(capsys.readouterr().out)] == [
        "train", "evaluate",
    ]  # fmt: skip


@pytest.mark.slow
def test_an_environment_that_is_only_known_to_this_process_is_flown_and_judged_in_it(tmp_path: Path) -> None:
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
def test_every_named_argument_is_a_key(name: str) -> None:
    keys = set(commands.find(name).config.__dataclass_fields__)
    named = {p.name for p in inspect.signature(getattr(aerial_il, name)).parameters.values() if p.kind != p.VAR_KEYWORD}
    assert named <= keys

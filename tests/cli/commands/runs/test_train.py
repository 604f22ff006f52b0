"""What ``aerial-il train`` is told: whom it learns from, where it flies, and every algorithm through the command."""

import json
from pathlib import Path

import pytest

import aerial_il
from aerial_il.cli import commands
from aerial_il.cli.compose import compose
from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError

QUIET = "progress=false"
SMALL = ["policy.hidden=[8]", QUIET]
AGENT = ["policy=squashed_gaussian", "algorithm.steps=60", "num_envs=2", *SMALL]
OFF_POLICY = [*AGENT, "algorithm.warmup=20", "algorithm.replay.batch_size=8", "algorithm.critics.hidden=[8]"]
ROLLOUT = ["algorithm.rollout.steps=30", "algorithm.critic_hidden=[8]"]
ROUNDS = ["algorithm.rounds=1", "algorithm.episodes=1", "algorithm.between_steps=2", "algorithm.training.steps=2"]
ALONE = "algorithm.gate.decay=0.01"  # the expert's share of a round: the learner, which has learned nothing, flies
PENDULUM = ["env=gymnasium:Pendulum-v1", "max_steps=20"]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Demonstrations of ``reach``, and a reward learned from them."""
    folder = tmp_path_factory.mktemp("train")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["collect", "task=reach", "episodes=2", "out=demos", QUIET]) == 0
        assert (
            main(["train", "algorithm=dac", "dataset=demos", "algorithm.bc_pretrain_steps=2", *OFF_POLICY, "run=dac"])
            == 0
        )
    return folder


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


def flown_in(run: Path) -> tuple[str, str, str]:
    spec = aerial_il.load_policy(str(run)).spec
    return spec.robot, spec.task, spec.tier


def test_dagger_asks_the_expert_of_the_task(home: Path) -> None:
    words = ["algorithm=dagger", "dataset=demos", "num_envs=1", "evaluate_every=0", ALONE, *ROUNDS, *SMALL]
    assert main(["train", *words, "run=dagger"]) == 0
    assert flown_in(home / "dagger") == ("ua_quad_arm4", "reach", "calm")
    rows = [json.loads(line) for line in (home / "dagger" / "metrics.jsonl").read_text().splitlines()]
    assert rows[-1]["queries"] > 0
    assert rows[-1]["flights_solved"] == 0, "what follows is about a flight that failed"
    for failures, count in ((0.0, 2), (1.0, 3)):
        cloning = [f"algorithm.selection.failures={failures}", "algorithm.steps=2", "algorithm.validation=0", *SMALL]
        assert main(["train", "dataset=dagger/dataset", *cloning, f"run=bc{count}"]) == 0
        assert aerial_il.load_policy(f"bc{count}").origin["dataset"]["demonstrations"] == count


def test_the_learned_reward_is_drawn(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reward", "dac", "dataset=demos", "episode=1"]) == 0
    assert "Mean reward: as flown" in capsys.readouterr().out
    assert (home / "dac" / "reward.svg").stat().st_size


@pytest.mark.parametrize(
    "other",
    [
        ["task=reach", "robot=big_four_z1"],
        ["env=gymnasium:Pendulum-v1", "max_steps=20", "policy=random", "success=survived"],
    ],
)
def test_no_reward_is_drawn_along_a_flight_from_elsewhere(
    tmp_path: Path, other: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["collect", *other, "episodes=1", f"out={tmp_path}", QUIET]) == 0
    assert main(["reward", "dac", f"dataset={tmp_path}"]) == 2
    assert "The policy was trained for reach on ua_quad_arm4" in capsys.readouterr().err


def test_who_learns_from_reward_needs_no_demonstrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "algorithm=sac", *PENDULUM, *OFF_POLICY, "evaluate_every=60", "run=pendulum"]) == 0
    assert flown_in(tmp_path / "pendulum")[:2] == ("gymnasium", "Pendulum-v1")
    kept = json.loads((tmp_path / "pendulum" / "command.json").read_text())
    assert kept["command"].startswith("aerial-il train policy=squashed_gaussian")
    assert " env=gymnasium:Pendulum-v1 max_steps=20 " in kept["command"]
    cell = ["robot=ua_quad_arm4", "task=reach", "tier=calm+wind", "action=ee_pose"]
    assert main(["train", "algorithm=ppo", *cell, *AGENT, *ROLLOUT, "run=reach"]) == 0
    assert flown_in(tmp_path / "reach") == ("ua_quad_arm4", "reach", "calm+wind")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "algorithm=bc learns from demonstrations: set dataset=PATH"),
        (["algorithm=dac", "policy=squashed_gaussian", *PENDULUM], "algorithm=dac learns from demonstrations"),
        (["algorithm=sac", "policy=squashed_gaussian"], "set env=KEY, or robot=... and task=..., or dataset=PATH"),
        (["algorithm=sac", "policy=squashed_gaussian", "robot=quad"], "set env=KEY, or robot=... and task=..."),
        (["algorithm=sac", "policy=squashed_gaussian", "robot=quad", *PENDULUM], "leave out robot=quad"),
        (
            ["algorithm=sac", "policy=squashed_gaussian", "max_steps=9"],
            "max_steps=9 is for an external environment",
        ),
        (["algorithm=sac", "policy=squashed_gaussian", *PENDULUM, "horizon=9"], "horizon= is for the suite: with env="),
        (["algorithm=sac", "policy=squashed_gaussian", "robot=z1", "task=reach", "horizon=-1"], "horizon is -1"),
        (["dataset=demos", *PENDULUM], "leave out max_steps"),
        (["dataset=demos", "horizon=50"], "already defines its environment: leave out horizon"),
        (["dataset=demos", "env=gymnasium:Pendulum-v1"], "robot=ua_quad_arm4; robot=gymnasium was asked for"),
        (["dataset=demos", "robot=quad"], "recorded with robot=ua_quad_arm4; robot=quad was asked for"),
        (["dataset=demos", "task=hover"], "recorded with task=reach; task=hover was asked for"),
        (["dataset=demos", "action=velocity"], "recorded with action=ee_pose; action=velocity was asked for"),
    ],
)
def test_what_does_not_go_together_is_refused(
    home: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", *words, "run=refused", QUIET]) == 2
    assert said in capsys.readouterr().err
    assert not (home / "refused").exists()


def test_what_a_dataset_is_of_may_be_said() -> None:
    said = ["robot=ua_quad_arm4", "task=reach", "tier=calm", "action=ee_pose"]
    assert main(["train", "dataset=demos", *said, *SMALL, "algorithm.steps=2", "run=said"]) == 0


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("policy=diffusion", r"experiment=quick sets policy\.hidden, which policy=diffusion does not have: leave out"),
        ("algorithm=dagger", r"algorithm\.steps, which algorithm=dagger does not have: leave out experiment=quick"),
    ],
)
def test_a_set_of_values_that_does_not_fit_is_refused(word: str, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        compose(commands.find("train"), ["run=x", "experiment=quick", word])


def test_where_success_forfeits_the_dense_reward_a_line_says_so(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = [
        "algorithm=ppo",
        "policy=squashed_gaussian",
        "algorithm.steps=64",
        "algorithm.rollout.steps=32",
        "num_envs=4",
    ]
    words = ["train", *short, "robot=z1", "task=reach", "action=velocity", QUIET]
    for run, said, warned in (
        ("dense", [], True),
        ("fixed", ["horizon=20"], False),
        ("sparse", ["algorithm.reward=sparse"], False),
    ):
        assert main([*words, *said, f"run={run}"]) == 0
        assert ("horizon=N" in capsys.readouterr().err) == warned, run
    assert " horizon=20 " in json.loads((home / "fixed" / "command.json").read_text())["command"]

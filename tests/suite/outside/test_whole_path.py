"""A recording of an environment from outside is a dataset like any other; a policy trained on it finds its way home."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Observation

QUIET = "progress=false"


class Balancer:
    """Pushes the cart the way that the pole falls."""

    def reset(self, mask: np.ndarray | None = None) -> None:
        pass

    def act(self, obs: Observation) -> np.ndarray:
        right = obs["observation"] @ np.array([0.1, 0.3, 3.0, 1.0]) > 0
        return np.stack([~right, right], axis=1).astype(float)


def test_record_train_and_judge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    monkeypatch.chdir(tmp_path)
    env = aerial_il.load_gymnasium("CartPole-v1", num_envs=3, max_steps=100)
    made = collect(env, Balancer(), range(6), tmp_path / "demos", policy_name="balancer", progress=False)
    assert len(made.demos) == 6
    dataset = aerial_il.open_dataset(str(tmp_path / "demos"))
    assert dataset.spec == env.spec
    assert all(len(episode) == 100 and episode.total_reward == 100 for episode in dataset)
    small = ["policy.hidden=[32,32]", "policy.chunk=1", "policy.ensemble=null", "algorithm.steps=150"]
    assert main(["train", "dataset=demos", "run=run", *small, QUIET]) == 0
    assert main(["evaluate", "policy=run", "out=judged", "episodes=6", "num_envs=4", "videos=0", QUIET]) == 0
    judged = json.loads((tmp_path / "judged" / "evaluation.json").read_text())
    assert judged["provenance"]["command"].startswith("aerial-il evaluate policy=run env=gymnasium:CartPole-v1 ")
    assert judged["return"]["mean"] > 75, "pushing at random earns about 20"
    assert "Return " in capsys.readouterr().out


def test_a_policy_records_where_it_is_told_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    where = ["env=gymnasium:Pendulum-v1", "max_steps=10", "success=return:-1000", QUIET]
    assert main(["collect", *where, "policy=random", "episodes=3", "out=flown"]) == 0
    assert [len(episode) for episode in aerial_il.open_dataset("flown")] == [10, 10, 10]
    assert main(["collect", *where, "episodes=3", "out=flown"]) == 2


def test_the_same_files_whatever_the_number_of_worlds(tmp_path: Path) -> None:
    for n in (1, 3):
        env = aerial_il.load_gymnasium("CartPole-v1", num_envs=n, max_steps=30)
        collect(env, Balancer(), range(4), tmp_path / str(n), policy_name="balancer", progress=False)
    one, three = ({f.name: f.read_bytes() for f in (tmp_path / n).rglob("*.mcap")} for n in ("1", "3"))
    assert one == three
    assert len(one) == 4

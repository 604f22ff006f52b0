"""HG-DAgger with somebody at the controls: rounds of real flights by the model of a driver, killed and continued."""

from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.interactive.gates.coin import CoinGate
from aerial_il.algorithms.interactive.gates.human import HumanGate
from aerial_il.algorithms.interactive.problem import Operator
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.experts.reach import EXPERT
from aerial_il.policies.mlp import MLP
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.driver.operator import DriverOperator
from aerial_il.teleop.driver.watch import Judgement
from aerial_il.teleop.session.logbook import POLICY_ACTION
from tests.teleop.hands import world

HASTY = Judgement(patience_ticks=15, step_m=0.05)  # one that soon loses patience with a policy of forty steps


class Killed(DriverOperator):
    """Is killed after the first flight of a call."""

    def record(self, env, learner, out, *, seeds, tags) -> None:
        super().record(env, learner, out, seeds=range(seeds.start, seeds.start + 1), tags=tags)
        raise KeyboardInterrupt


@pytest.fixture(scope="module")
def env() -> BatchEnvironment:
    return world()


def train(env: BatchEnvironment, folder: Path, operator: DriverOperator, gate=HumanGate()) -> None:  # noqa: B008
    demos = folder / "demos"
    DriverOperator().record(env, None, demos, seeds=range(2), tags={})
    training = BC(steps=40, validation=0.0)
    settings = DAgger(gate=gate, rounds=1, episodes=2, training=training, between_steps=20, evaluate_every=0)
    options = {"env": env, "expert": operator, "collect": collect, "progress": False}
    settings.train(aerial_il.open_dataset(str(demos)), MLP(), run=folder / "run", **options)


def test_a_round_killed_halfway_keeps_its_flights(env: BatchEnvironment, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(env, tmp_path, Killed(judgement=HASTY))
    (kept,) = (tmp_path / "run" / "rounds" / "001").glob("*/*/*.mcap")
    before = kept.read_bytes()
    train(env, tmp_path, DriverOperator(judgement=HASTY))
    flights = list(open_dataset(tmp_path / "run" / "rounds" / "001" / "flights", failures=True))
    assert len(flights) == 2
    (again,) = (tmp_path / "run" / "rounds" / "001" / "flights").glob(f"*/{kept.name}")
    assert again.read_bytes() == before, "a finished flight is never flown again"
    row = read_metrics(tmp_path / "run")[-1]
    assert row["flights"] == 2
    assert row["expert_steps"] == sum(int(e.is_intervention.sum()) for e in flights) > 0
    assert row["queries"] == row["expert_steps"], "what the person flew is what is learned, no more"
    assert row["solved_alone"] == sum(e.success and not e.is_intervention.any() for e in flights)
    for flight in flights:
        np.testing.assert_array_equal(flight.asked, flight.is_intervention)
        assert flight.extras[POLICY_ACTION].shape == flight.actions.shape
        assert flight.provenance["policy"] == "learner with human:driver"


def test_a_gate_that_would_decide_in_their_place_is_refused(env: BatchEnvironment, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="algorithm=hg_dagger"):
        train(env, tmp_path, DriverOperator(), CoinGate())


def test_an_expert_is_no_operator() -> None:
    assert isinstance(DriverOperator(), Operator)
    assert not isinstance(EXPERT(), Operator)

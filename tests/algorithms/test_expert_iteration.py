"""Expert iteration flies each start with one attempt after another, and keeps one success of each."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import ARRAYS
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import SPEC, Drift, demonstrations
from tests.algorithms.train_rounds import flights_of

STARTS = 48
FEW = BC(steps=300, batch_size=32, lr=3e-3, warmup_steps=5, ema=0.9, validation=0.0, validate_every=0)
POLICY = SquashedGaussian(hidden=(32,))
LAMPLIT = replace(SPEC, observation=ObservationSpec((*SPEC.observation.fields, Field("lamp", (1,)))))


class Lamplit(Drift):
    """A lamp stands wherever it likes; in all demonstrations it stood at the goal."""

    spec = LAMPLIT

    def _observe(self) -> dict[str, np.ndarray]:
        lamp = np.array([named_rng(int(1e6 * abs(goal)), "lamp").uniform(-1, 1, 1) for goal in self.goal[:, 0]])
        return {**super()._observe(), "lamp": lamp}


def by_lamplight(count: int) -> list[Episode]:
    demos = demonstrations(count, ends_at_success=True)
    return [replace(demo, spec=LAMPLIT, obs={**demo.obs, "lamp": demo.obs["goal"].copy()}) for demo in demos]


def trained(run: Path, *, seed: int = 3, env: Any = None, **settings: Any) -> Path:
    default = {"training": FEW, "between_steps": 300, "rounds": 2, "episodes": STARTS, "attempts": 4, "hold": 1e3}
    default["demos_share"] = 0.02
    options = {"env": env or Lamplit(8, ends_at_success=True), "collect": collect, "seed": seed, "progress": False}
    ExpertIteration(**{**default, **settings}).train(by_lamplight(12), POLICY, run=run, **options)
    return run


def turns(run: Path, number: int) -> list[dict[str, int]]:
    return json.loads((run / "rounds" / f"{number:03d}" / "turns.json").read_text())


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp("iterated") / "run")


def test_each_attempt_flies_what_none_before_it_solved(whole: Path) -> None:
    for number in (1, 2):
        told, left = turns(whole, number), STARTS
        assert 1 < len(told) <= 4, "a check of a single turn would tell nothing"
        for turn in told:
            assert turn["flights"] == left
            left -= turn["successes"]
        assert len(told) == 4 or left == 0


def test_one_success_of_each_start_is_kept_and_nothing_else(whole: Path) -> None:
    for number in (1, 2):
        flights = flights_of(whole, number)
        assert len(flights) == sum(turn["successes"] for turn in turns(whole, number)) > 0
        assert all(flight.success for flight in flights)
        assert len({flight.seed for flight in flights}) == len(flights)
        assert {flight.provenance["settings"]["turn"] for flight in flights} - {0}, "only the first ever solved one"


def test_the_learner_no_longer_heeds_what_misled_it(whole: Path, tmp_path: Path) -> None:
    alone = trained(tmp_path / "alone", attempts=1)
    first, last = (read_metrics(whole)[number]["starts_solved_first"] for number in (1, 2))
    assert last > first + 0.1
    assert last > read_metrics(alone)[2]["starts_solved_first"] + 0.1, "its own successes taught it as much"


def test_fields_are_hidden_from_the_explorer_alone(whole: Path) -> None:
    """A learner that trains without them flies by them as well as it can."""

    def hidden(training: str) -> float:
        config = yaml.safe_load((whole / "rounds" / "001" / training / "config.yaml").read_text())
        return config["settings"]["field_dropout"]

    assert (hidden("training"), hidden("explorer")) == (0.0, ExpertIteration().explorer_dropout)
    assert hidden("explorer") > 0.0


def test_metrics_count_every_flight(whole: Path) -> None:
    rows = read_metrics(whole)
    steps = 0
    for number, row in enumerate(rows[1:], start=1):
        told = turns(whole, number)
        steps += sum(turn["steps"] for turn in told)
        assert row["flights"] == sum(turn["flights"] for turn in told)
        assert row["total/flight_steps"] == steps > 0
        assert row["starts_solved_first"] == told[0]["successes"] / STARTS
        assert row["starts_solved"] == len(flights_of(whole, number)) / STARTS > row["starts_solved_first"]


def test_a_round_cut_short_is_flown_anew_to_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    second = run / "rounds" / "002"
    shutil.rmtree(second / "training")
    shutil.rmtree(run / "policy")
    shutil.rmtree(next((run / "checkpoints").glob("*2")))
    (second / "flights").rename(second / "flights.flying")  # as a kill between two turns leaves it
    (second / "turns.json").unlink()
    trained(run)
    assert (run / "policy" / ARRAYS).read_bytes() == (whole / "policy" / ARRAYS).read_bytes()
    assert turns(run, 2) == turns(whole, 2)


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="attempts is 0"):
        ExpertIteration(attempts=0)
    with pytest.raises(InvalidValueError, match="hidden is 2"):
        ExpertIteration(hidden=2.0)

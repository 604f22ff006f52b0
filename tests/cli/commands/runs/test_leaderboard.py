"""Standings from evaluations alone: trainings of one method together, what does not fit named, a submission judged."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.evaluation import statistics
from aerial_il.evaluation.leaderboard import FEWEST, TRAINED, standings
from aerial_il.evaluation.result import EvaluationResult, load_result
from tests.experiments.results import result_with

QUIET = "progress=false"


def flown(won: int, *, draw: int = 0, policy: str = "mlp", **provenance: object) -> EvaluationResult:
    how = {"algorithm": "bc", "policy": policy, "demonstrations": 80, "seconds": 60.0 * (1 + draw), "settings": {}}
    made = {"engine": "4", "policy_sha256": f"{policy}{draw}", "command": f"aerial-il {policy} {draw}", TRAINED: how}
    return replace(result_with(100, won), provenance={**made, **provenance})


def test_trainings_of_one_method_stand_together() -> None:
    board = standings({"a": flown(90), "b": flown(80, draw=1), "c": flown(95, policy="act")})
    first, second = board.standings
    assert (first.method, first.rate, first.trainings) == ("act, 80 demonstrations", 0.95, 1)
    assert (second.method, second.rate, second.trainings) == ("mlp, 80 demonstrations", 0.85, 2)
    assert first.ci95 == pytest.approx(statistics.wilson(95, 100))
    pooled = statistics.wilson(170, 200)
    assert second.ci95.lo <= pooled.lo
    assert second.ci95.hi >= pooled.hi
    assert (second.minutes, second.demonstrations) == (1.5, 80)
    assert second.commands == ("aerial-il mlp 0", "aerial-il mlp 1")


def test_other_settings_or_words_make_another_method() -> None:
    small, large = ({**flown(90).provenance[TRAINED], "settings": {"policy.hidden": [size]}} for size in (8, 256))
    told = {"environment": {"instruction": "Press it."}}
    results = {
        "a": flown(90, **{TRAINED: small}),
        "b": flown(80, draw=1, **{TRAINED: large}),
        "c": flown(70, draw=1, **{TRAINED: large}, **told),
    }
    board = standings(results)
    assert not board.left_out
    assert [(each.rate, each.trainings) for each in board.standings] == [(0.9, 1), (0.8, 1), (0.7, 1)]
    assert "hidden=[8]" in board.standings[0].method
    assert "instruction=Press it." in board.standings[2].method


def test_more_seeds_of_one_policy_are_no_further_training() -> None:
    first = flown(90)
    later = replace(first, episodes=tuple(replace(each, seed=each.seed + 100) for each in first.episodes))
    halfway = replace(first, episodes=tuple(replace(each, seed=each.seed + 50) for each in first.episodes))
    board = standings({"a": first, "b": later, "c": halfway})
    (only,) = board.standings
    assert (only.trainings, only.episodes) == (1, 200)
    assert board.left_out == {"c": "has 50 seeds of a again"}
    trained = flown(90, **{TRAINED: {**first.provenance[TRAINED], "settings": {"lr": 1e-3}}})
    assert standings({"run": trained, "run/policy": first}).left_out == {"run/policy": "is run again"}


def test_flights_of_one_seed_count_once_in_an_interval() -> None:
    shorter = flown(0, draw=2)
    shorter = replace(shorter, episodes=shorter.episodes[:60])
    (none,) = standings({"a": flown(0), "b": flown(0, draw=1), "c": shorter}).standings
    assert (none.trainings, none.episodes, none.ci95) == (3, 260, statistics.wilson(0, 100))


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (flown(90, draw=1, engine="3"), "version 3 of the engine, the others with 4"),
        (replace(result_with(FEWEST - 1, 9), provenance=flown(9).provenance), "has 49 episodes; 50 are needed"),
        (flown(90), "is a again"),
        (flown(90, draw=1, environment={"latency": {"action_delay_ms": 40}}), "latency of its own"),
    ],
)
def test_what_does_not_fit_is_named_and_left_out(other: EvaluationResult, why: str) -> None:
    board = standings({"a": flown(90), "b": flown(91, draw=2), "c": other})
    assert list(board.left_out) == ["c"]
    assert why in board.left_out["c"]
    assert sum(each.trainings for each in board.standings) == 2


def test_a_submission_is_judged_on_seeds_of_the_day(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = ["robot=quad", "task=hover", "episodes=2", "videos=0", QUIET]
    assert main(["evaluate", "policy=expert", *cell, f"out={tmp_path / 'all' / 'expert'}"]) == 0
    words = [str(tmp_path / "all"), "fewest=2", f"out={tmp_path / 'board.html'}"]
    assert main(["leaderboard", *words, "submission=hover", "episodes=2", QUIET]) == 0
    assert main(["leaderboard", *words, "submission=hover", "episodes=2", QUIET]) == 0
    judged = [load_result(file) for file in (tmp_path / "all" / "submissions").rglob("evaluation.json")]
    assert len({result.seeds[0] for result in judged}) == 2, "nobody knows them before"
    assert min(result.seeds[0] for result in judged) >= 1_000_000
    page = (tmp_path / "board.html").read_text()
    assert "Hover on quad" in page
    assert "submission=FOLDER" in page
    assert "success" in capsys.readouterr().out
    one = tmp_path / "all" / "expert" / "evaluation.json"
    assert main(["leaderboard", str(one), *words[1:], "submission=hover", "episodes=2", QUIET]) == 0


def test_no_evaluation_and_a_policy_of_nowhere_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["leaderboard", str(tmp_path), f"out={tmp_path / 'board.html'}"]) == 2
    assert "holds no evaluation" in capsys.readouterr().err
    flown(90).save(tmp_path / "a")
    words = [str(tmp_path), f"out={tmp_path / 'board.html'}", f"submission={tmp_path / 'nothing'}", QUIET]
    assert main(["leaderboard", *words]) == 2
    assert "flies in no cell of the board" in capsys.readouterr().err
    assert json.loads((tmp_path / "a" / "evaluation.json").read_text())["policy"] == "mlp"

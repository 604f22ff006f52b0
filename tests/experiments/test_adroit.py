"""Studies on the Adroit hand: published rewards, what is shown, its control, and what can be missed."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.rollouts import evaluate
from experiments.adroit import tables as adroit_tables
from experiments.adroit.people import flown_by_people
from experiments.adroit.study import Adroit
from experiments.adroit.tasks import TASKS, PublishedRewards, expert_of
from experiments.adroit_rl.study import ASKED, CELLS, CLONE, CONTROL, AdroitRl, Arm, targets_of
from experiments.common.outside import OutsideStages
from experiments.common.record import Record
from experiments.common.stages import steps_of
from tests.experiments.results import result_with

DATA = next(
    (p / "shared" / "data" / "adroit" for p in Path(__file__).resolve().parents if (p / "shared" / "data").is_dir()),
    Path("absent"),
)
needs_experts = pytest.mark.skipif(not DATA.is_dir(), reason="the experts of DAPG are not beside the repository")
needs_robotics = pytest.mark.skipif(
    importlib.util.find_spec("gymnasium_robotics") is None, reason="gymnasium-robotics is not installed"
)


@needs_experts
@needs_robotics
@pytest.mark.parametrize("name", TASKS)
def test_the_experts_earn_what_was_published(name: str) -> None:
    task = TASKS[name]
    env = PublishedRewards(task, 2)
    result = evaluate(env, expert_of(task, DATA, noise=0.0), [0, 1], policy_name="expert", progress=False)
    assert result.success["count"] == 2
    scores = task.score(np.array([episode.return_ for episode in result.episodes]))
    assert (scores > 40).all(), "single episodes of relocate differ much by how soon the ball is there"
    assert [e.steps for e in result.episodes] == [200, 200]
    assert all(e.time_to_success_s and e.time_to_success_s < e.duration_s for e in result.episodes)


@needs_experts
@needs_robotics
def test_the_noise_of_an_expert_depends_on_the_episode_alone() -> None:
    task = TASKS["door"]

    def first_actions(n: int, seed: int) -> np.ndarray:
        env, expert = PublishedRewards(task, n), expert_of(task, DATA, noise=1.0)
        expert.attach(env)
        obs = env.reset(seed)
        expert.reset()
        return np.stack([expert.act(obs), expert.act(obs)])

    assert np.array_equal(first_actions(2, 4)[:, 1], first_actions(1, 5)[:, 0])
    assert not np.array_equal(*first_actions(1, 5))


def test_a_missing_folder_is_said_and_skipped(tmp_path: Path) -> None:
    report = Adroit(data=str(tmp_path / "nowhere")).run(tmp_path, progress=False)
    assert not report.targets
    assert "bench.data=FOLDER" in report.notes[0]
    with pytest.raises(InvalidValueError, match="does not exist; say"):
        expert_of(TASKS["door"], tmp_path, noise=0.0)


def test_a_control_takes_as_many_steps() -> None:
    training = BC(steps=100)
    asking = {"ask": DAgger(rounds=5, between_steps=40, training=training)}
    study = Adroit(clean=({"demos": 15, "bc_as_ask": 2, "ask": 1},), interactive=asking, algorithm=training, seeds=1)
    points = [point for point in study.points() if point.clean]
    assert [(p.method, p.seed) for p in points] == [("bc_as_ask", 0), ("ask", 0), ("bc_as_ask", 1)]
    assert [steps_of(study.learner(point)) for point in points] == [360, 360, 360]
    assert study._source(points[0]) == study._source(points[1]) != study._source(points[2])


def row(percent: float, *, queries: int = 100, demos: int = 30, score: float = 90.0) -> dict[str, Any]:
    ends = {"ci95_low": percent - 3, "ci95_high": percent + 3, "score_low": score - 2, "score_high": score + 2}
    told = {"queries": queries, "labelled_steps": 2 * queries, "demos": demos, "score": score}
    return {"percent": percent, "success": round(3 * percent), "episodes": 300, "noise_free": True, **ends, **told}


def test_wide_intervals_do_not_make_a_learner_as_good() -> None:
    taught = row(96.0)
    assert [t.met for t in adroit_tables.thrift_targets(taught, [row(96.0, queries=40)])] == [True, True, True]
    assert [t.met for t in adroit_tables.thrift_targets(taught, [row(96.0, queries=40, score=80.0)])] == [
        True,
        True,
        False,
    ]
    few = {**row(90.0, queries=60), "success": 9, "episodes": 10}
    assert [t.met for t in adroit_tables.thrift_targets(taught, [few])] == [False, False, True]


def test_dagger_is_judged_beside_cloning_with_as_many_steps_only() -> None:
    dagger = {**row(95.0, demos=15), "policy": "mlp-dagger"}
    short = {**row(85.0, demos=15), "policy": "mlp"}
    equal = {**row(94.0, demos=15), "policy": "mlp-bc_as_dagger"}
    assert not list(adroit_tables.interactive_targets([dagger, short]))
    assert [t.met for t in adroit_tables.interactive_targets([dagger, short, equal])] == [False]


@needs_experts
def test_what_people_flew_fits_the_environment() -> None:
    env = PublishedRewards(TASKS["door"], 1, CELLS["door"].max_steps)
    shown = flown_by_people(TASKS["door"], DATA, env.spec)
    env.close()
    assert len(shown) == CELLS["door"].demos
    assert {len(episode.obs["observation"]) - len(episode) for episode in shown} == {1}
    assert max(map(len, shown)) < env.spec.max_steps
    assert all((np.abs(episode.actions) <= 1.0).all() for episode in shown)


def test_a_clone_was_not_trained_for_itself_and_has_no_minutes(tmp_path: Path) -> None:
    stages = OutsideStages(record=Record(tmp_path))
    row = AdroitRl()._row(Arm("door", CLONE, "environment"), [result_with(4, 1)], stages)
    assert (row["minutes"], row["steps"], row["percent"]) == (None, 0, 25.0)


@needs_experts
def test_draws_differ_where_experts_fly(tmp_path: Path) -> None:
    study, stages = AdroitRl(data=str(DATA)), OutsideStages(record=Record(tmp_path))
    expert, people = (
        [study.training(Arm(task, ASKED, "environment"), draw, stages).shown for draw in (0, 1)]
        for task in ("relocate", "door")
    )
    assert expert[0] != expert[1]
    assert people[0] == people[1]
    control = study.training(Arm("door", CONTROL, "environment"), 0, stages)
    assert control.shown is None
    assert control.algorithm.steps == study.dapg.steps


@needs_experts
def test_a_control_that_never_sees_a_reward_flies_all_its_steps(tmp_path: Path) -> None:
    study, stages = AdroitRl(data=str(DATA)), OutsideStages(record=Record(tmp_path))
    arms = (Arm("door", CONTROL, reward) for reward in ("sparse", "environment"))
    sparse, dense = (study.training(arm, 0, stages).algorithm for arm in arms)
    assert sparse.reward_patience == 0
    assert dense.reward_patience == study.npg.reward_patience


def test_both_targets_can_be_missed() -> None:
    default = {"steps": 1, "trainings": 1, "success": 1, "episodes": 1, "flights_low": 0.0, "flights_high": 100.0}
    default |= {"trainings_low": None, "trainings_high": None, "worst": 0.0, "best": 0.0}

    def verdicts(asked: float, control: float) -> list[bool | None]:
        percents = {ASKED: asked, CONTROL: control}
        rows = {Arm("door", name, "environment"): {**default, "percent": value} for name, value in percents.items()}
        return [target.met for target in targets_of(rows)]

    assert verdicts(80.0, 5.0) == [True, True]
    assert verdicts(79.0, 6.0) == [False, False]


def test_unknown_tasks_and_missing_data_are_answered(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="relocate"):
        AdroitRl(tasks=("pen",))
    with pytest.raises(InvalidValueError, match="start at 1"):
        AdroitRl(worlds=0)
    report = AdroitRl(data=str(tmp_path / "none")).run(tmp_path, progress=False)
    assert "bench.data=FOLDER" in report.tables["Skipped"][0]["why"]

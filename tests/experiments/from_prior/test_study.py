"""The study of learning from a prior: a small one runs beside its controls, once, and its targets can be missed."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.composition import changed
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.statistics import mcnemar
from aerial_il.policies.mlp import MLP
from experiments.common import practised
from experiments.common.demonstrations import Source
from experiments.common.practised import Continued, Practised
from experiments.common.record import digest
from experiments.common.stages import Cloned
from experiments.from_prior import practice_notes
from experiments.from_prior import study as from_prior
from experiments.from_prior.study import BEGINNING, CLONE, SHOWN_MORE, FromPrior
from experiments.from_prior_big_four.study import FromPriorBigFour

ITERATED = "expert_iteration"
CLONING = BC(steps=10, batch_size=16)
ROUNDS: dict[str, Any] = {"rounds": 2, "episodes": 2, "training": CLONING, "between_steps": 5, "evaluate_every": 0}
SMALL: dict[str, Any] = {
    "policy": MLP(hidden=(16,)),
    "cloning": CLONING,
    "beginning": replace(CLONING, field_dropout=0.6),
    "practising": {
        ITERATED: ExpertIteration(**{**ROUNDS, "training": replace(CLONING, validation=0.0)}, attempts=2),
        "filtered_bc": FilteredBC(**ROUNDS),
    },
    "starts": {"reach": (2,)},
    "many": 3,
    "harder": "hard",
    "draws": (0,),
    "episodes": 1,
    "num_envs": 1,
    "threads": 1,
}


@pytest.mark.slow
def test_a_small_study_runs_and_resumes(tmp_path: Path) -> None:
    report = FromPrior(**SMALL).run(tmp_path, progress=False)
    success = report.tables["Success"]
    assert [(row["arm"], row["tier"]) for row in success] == [
        (arm, tier) for arm in (CLONE, BEGINNING, ITERATED, "filtered_bc", SHOWN_MORE) for tier in ("calm", "hard")
    ]
    flown = {row["arm"]: row["flown"] for row in success}
    assert flown[CLONE] == flown[SHOWN_MORE] == 0
    for name in (ITERATED, "filtered_bc"):
        (run,) = {
            file.parent for file in tmp_path.glob(f"training/{name}/**/metrics.jsonl") if "rounds" not in file.parts
        }
        assert flown[name] == sum(row["flight_steps"] for row in read_metrics(run)) > 0

    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    again = FromPrior(**SMALL).run(tmp_path, progress=False)
    assert again.tables == report.tables
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == files


def rows_of(arm: str, percent: float, harder: float, minutes: float = 60.0) -> list[dict[str, Any]]:
    head = {"arm": arm, "task": "pick_place", "demos": 10, "minutes": minutes}
    return [{**head, "tier": "calm", "percent": percent}, {**head, "tier": "gusts", "percent": harder}]


def test_a_target_is_reached_in_both_tiers_and_in_time() -> None:
    fine = [row for arm in ("bc_ppo", "dapg") for row in rows_of(arm, 95.0, 90.0)]
    for arm, *numbers, reached in (
        ("jsrl", 95.0, 90.0, 60.0, 3),
        ("jsrl", 89.9, 90.0, 60.0, 2),
        ("jsrl", 95.0, 84.9, 60.0, 2),
        ("jsrl", 95.0, 90.0, 181.0, 2),
        ("filtered_bc", 95.0, 90.0, 60.0, 2),
        (CLONE, 95.0, 90.0, 60.0, 2),
    ):
        (target,) = FromPrior().targets_of([*fine, *rows_of(arm, *numbers)])
        assert (target.limit, target.measured, target.met) == (3, reached, reached == 3)
    assert not list(FromPrior().targets_of(rows_of("filtered_bc", 95.0, 90.0)))
    assert not list(FromPrior().targets_of([{**row, "demos": 11} for row in fine]))
    assert not list(FromPrior(robot="quad").targets_of(fine)), "nothing is wanted of another robot"


def test_a_method_that_adds_nothing_does_not_count() -> None:
    """Else whoever goes on from it, and learns nothing, would reach the target."""
    rows = [row for arm in ("expert_iteration", "bc_ppo", "dapg") for row in rows_of(arm, 95.0, 90.0)]

    def gains(before: float, won: int, lost: int) -> list[dict[str, Any]]:
        """What ``dapg`` gained in gusts; in calm air nothing."""
        head = {"arm": "dapg", "task": "pick_place", "demos": 10, "before": before}
        counts = {"calm": (0, 0), "gusts": (won, lost)}
        return [{**head, "tier": t, "won": w, "lost": n, "p": mcnemar(w, n)} for t, (w, n) in counts.items()]

    for before, won, lost, counted in ((95.0, 9, 9, 2), (95.0, 17, 4, 3), (95.0, 4, 17, 2), (50.0, 9, 9, 3)):
        (target,) = FromPrior().targets_of(rows, gains(before, won, lost))
        assert target.measured == counted
        assert ("not counted: dapg" in target.spread) == (counted == 2)


def test_the_heavy_vehicle_is_judged_in_both_tiers() -> None:
    study = FromPriorBigFour()
    assert (study.robot, study.practised_in["insert_peg"]) == ("big_four_z1", "gusts")
    for arm, percent, harder, met in (
        ("expert_iteration", 80.0, 80.0, True),
        ("bc_ppo", 95.0, 79.9, False),
        ("bc_ppo", 79.9, 95.0, False),
        ("filtered_bc", 95.0, 95.0, None),
        (CLONE, 95.0, 95.0, None),
    ):
        rows = [{**row, "task": "insert_peg", "demos": 40} for row in rows_of(arm, percent, harder)]
        assert [target.met for target in study.targets_of(rows)] == ([] if met is None else [met])


def test_the_shipped_study_flies_the_shipped_algorithms() -> None:
    study = FromPrior()
    paid_for_success = {"reward", "reward_patience", "demonstrations", "steps"}  # what is not their own default
    own = {"ibrl": {"warmup"}, "rlpd": set[str](), "ppo": {"rollout"}}
    for name, algorithm in study.practising.items():
        shipped = algorithms.get(name)()
        changed = {s.name for s in fields(shipped) if getattr(shipped, s.name) != getattr(algorithm, s.name)}
        assert changed <= (paid_for_success | own[name] if name in own else set()), name
        assert getattr(algorithm, "reward", "sparse") == "sparse"


def test_every_arm_stands_in_the_order_of_the_page() -> None:
    assert list(FromPrior().named_arms()) == list(FromPrior().practising)


def test_what_is_shown_nothing_is_trained_once() -> None:
    starts: Any = {"starts": {"reach": (2, 4)}, "only_from": {}}
    arms = list(FromPrior(**starts, draws=(0,), arms=("bc_ppo", "ppo")).all_arms())
    assert [arm.demos for arm in arms if arm.name == "ppo"] == [0]
    assert [arm.demos for arm in arms if arm.name == "bc_ppo"] == [2, 4]


@pytest.mark.parametrize("wrong", [{"starts": {}}, {"starts": {"reach": (0,)}}, {"draws": ()}, {"many": 0}])
def test_a_study_of_nothing_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError):
        FromPrior(**wrong)


def test_an_arm_may_be_trained_in_fewer_draws() -> None:
    arms = list(FromPrior(starts={"reach": (2,)}, arms=("bc_ppo", "dapg"), fewer={"dapg": 1}).all_arms())
    assert [arm.training.source.draw for arm in arms if arm.name == "bc_ppo"] == [0, 1, 2]
    assert [arm.training.source.draw for arm in arms if arm.name == "dapg"] == [0]
    with pytest.raises(InvalidValueError, match="fewer"):
        FromPrior(fewer={"dapg": 0})


def test_an_arm_may_be_trained_from_some_of_the_starts_alone() -> None:
    only_from = {"dapg": ("reach_4",), "ppo": ("pick_place_0",)}
    study = FromPrior(starts={"reach": (2, 4)}, draws=(0,), arms=("bc_ppo", "dapg", "ppo"), only_from=only_from)
    arms = [(arm.name, arm.demos) for arm in study.all_arms() if arm.name in study.practising]
    assert arms == [("bc_ppo", 2), ("bc_ppo", 4), ("dapg", 4)]
    with pytest.raises(UnknownNameError, match="dapgg"):
        FromPrior(only_from={"dapgg": ("reach_4",)})
    with pytest.raises(UnknownNameError, match="reech"):
        FromPrior(only_from={"dapg": ("reech_4",)})


def test_practice_is_shorter_only_where_it_is_said() -> None:
    shorter = {"shorter": {"reach_4": 200_000}, "only_from": {}}
    study = FromPrior(starts={"reach": (2, 4)}, arms=("bc_ppo", "ibrl"), draws=(0,), **shorter)
    steps = {
        (arm.name, arm.demos): arm.training.algorithm.steps
        for arm in study.all_arms()
        if isinstance(arm.training, Continued)
    }
    assert steps == {("bc_ppo", 2): 16_000_000, ("bc_ppo", 4): 200_000, ("ibrl", 2): 30_000, ("ibrl", 4): 30_000}


def test_a_task_can_be_practised_in_another_tier() -> None:
    starts = {"pick_place": (10,), "insert_peg": (40,)}
    study = FromPrior(starts=starts, arms=("bc_ppo", "ppo"), draws=(0,), practised_in={"insert_peg": "hard"})
    tiers = {(a.training.source.task, a.training.source.tier) for a in study.all_arms()}
    assert tiers == {("pick_place", "calm"), ("insert_peg", "hard")}
    told = 'pick_place in calm, 10 times; insert_peg in hard, 40 times; "many demonstrations" are 400.'
    assert told in next(study.notes_of([]))
    assert study._panel("pick_place", 10) == "pick_place from 10, in calm"
    assert study._panel("insert_peg", 40) == "insert_peg from 40, in hard, final in calm", "which is not judged in hard"
    assert FromPrior()._panel("insert_peg", 40) == "insert_peg from 40, in gusts"


def test_figures_show_each_task_in_its_own_tier(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(from_prior, "practice_lines", lambda rows, final, **options: drawn.update(options, final=final))
    rows = [
        {"task": task, "demos": 40, "tier": tier} for task in ("pick_place", "insert_peg") for tier in ("calm", "gusts")
    ]
    nothing: Any = SimpleNamespace(lines=[])
    FromPrior().drawn_figures(rows, nothing)
    assert [(row["task"], row["tier"]) for row in drawn["final"]] == [("pick_place", "calm"), ("insert_peg", "gusts")]
    assert drawn["titles"]["insert_peg", 40] == "insert_peg from 40, in gusts"
    assert (drawn["wanted"]["pick_place", 40], drawn["wanted"]["insert_peg", 40]) == (98.0, 85.0)


def test_a_page_names_only_the_arms_on_it() -> None:
    study: Any = FromPriorBigFour()
    said = "\n".join(study.notes_of(list(study.all_arms())))
    assert said.startswith("Robot: big_four_z1, demonstrated by its scripted expert with a noise of 0.3")
    assert "insert_peg in gusts, 40 times" in said
    assert "10000 to 10199" in said
    assert "20 times on the way" in said
    for name in ("ppo is", "rlpd", "ibrl", "residual", "dapg", "jsrl", BEGINNING, "Slow methods"):
        assert name not in said
    everything = "\n".join(FromPrior().notes_of(list(FromPrior().all_arms())))
    for name in (*FromPrior().practising, BEGINNING, "Slow methods"):
        assert name in everything
    assert set(practice_notes.SLOW) == set(from_prior.FEWER)


def test_settings_can_be_tried_on_seeds_that_judge_nothing() -> None:
    assert FromPrior(first_episode=5_000).judging_seeds == range(5_000, 5_200)
    with pytest.raises(InvalidValueError, match="demonstrations use others"):
        FromPrior(first_episode=5_900)


def test_a_task_can_have_settings_of_its_own() -> None:
    changes = {
        "dapg": {"exploration": {"noise": 0.1}},
        "expert_iteration": {"training": {"steps": 5}},
        "beginning": {"steps": 3},
    }
    study = FromPrior(
        starts={"reach": (2,), "hover": (2,)},
        arms=("dapg", "residual", "expert_iteration"),
        draws=(0,),
        suited={"hover": changes},
    )
    arms = {(a.name, a.training.source.task): a.training for a in study.all_arms()}
    usual: Any = study.practising
    assert arms["dapg", "hover"].algorithm == changed(usual["dapg"], changes["dapg"])
    rounds = usual["expert_iteration"]
    assert arms[ITERATED, "hover"].algorithm == replace(rounds, training=replace(rounds.training, steps=5))
    assert all(arms[name, "reach"].algorithm == usual[name] for name in study.arms)
    assert arms["residual", "hover"].algorithm == usual["residual"]
    begun = replace(study.beginning, steps=3)
    assert arms[BEGINNING, "hover"].algorithm == arms["dapg", "hover"].beginning.algorithm == begun
    assert arms[BEGINNING, "reach"].algorithm == arms["dapg", "reach"].beginning.algorithm == study.beginning


def test_practice_can_go_on_from_other_practice() -> None:
    study = FromPrior(
        starts={"reach": (2,), "pick_place": (2,)},
        arms=(ITERATED, "bc_ppo", "rlpd"),
        draws=(0,),
        begun_by={"pick_place": ITERATED},
        only_from={},
        suited={"pick_place": {ITERATED: {"rounds": 3}}},
    )
    arms: Any = {(a.name, a.training.source.task): a.training for a in study.all_arms()}
    begun = arms["bc_ppo", "pick_place"].prior
    assert digest(begun.decided_by()) == digest(arms[ITERATED, "pick_place"].decided_by()), "of the arm beside it"
    assert isinstance(arms["bc_ppo", "reach"].prior, Cloned)
    assert arms["rlpd", "pick_place"].prior is None
    assert (BEGINNING, "pick_place") not in arms, "nothing begins with that clone"
    assert (BEGINNING, "reach") in arms


@pytest.mark.parametrize("wrong", ["bc_ppo", "expert_iterating"])
def test_practice_goes_on_from_what_practised_in_rounds_alone(wrong: str) -> None:
    with pytest.raises(UnknownNameError, match=r"begun_by.*expert_iteration, filtered_bc"):
        FromPrior(begun_by={"insert_peg": wrong})
    assert FromPrior(begun_by={"hover": wrong}), "which is not flown"


@pytest.mark.parametrize(
    ("name", "value"), [("starts", (10,)), ("begun_by", ITERATED), ("practised_in", "calm"), ("suited", {})]
)
def test_a_task_that_is_none_is_refused_wherever_it_is_named(name: str, value: Any) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'pick_place'"):
        FromPrior(**{name: {"pick_plaice": value}})


@pytest.mark.parametrize(
    ("changes", "wanted"), [({"dapg": {"exploration": {"nose": 0.1}}}, "noise"), ({"dagp": {}}, "dapg")]
)
def test_unknown_names_in_suited_are_answered(changes: Any, wanted: str) -> None:
    with pytest.raises(UnknownNameError, match=f"Did you mean '{wanted}'"):
        FromPrior(suited={"hover": changes})


def test_practice_starts_from_the_clone_in_the_table() -> None:
    arms = {arm.name: arm.training for arm in FromPrior(starts={"reach": (2,)}, draws=(0,)).all_arms()}
    hiding = digest(arms[BEGINNING].decided_by())
    assert hiding != digest(arms[CLONE].decided_by())
    for training in arms.values():
        if isinstance(training, Continued) and training.prior:
            assert digest(training.prior.decided_by()) == hiding
    own = arms[ITERATED].algorithm
    assert isinstance(own, ExpertIteration)
    usual = FromPrior().beginning
    assert (own.training, own.explorer_dropout) == (replace(usual, field_dropout=0.0), usual.field_dropout), (
        "what makes its own clones makes them in the same way, one with hidden fields and one without"
    )


def test_an_arm_that_is_none_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="filtered_bc"):
        FromPrior(arms=("sac",))


def decisions_of(study: FromPrior) -> dict[str, str]:
    """Return a digest of all that decides the trainings of each arm."""
    return {f"{arm.name}/{arm.demos}": digest(arm.training.decided_by()) for arm in study.all_arms()}


def test_an_arm_that_is_added_leaves_what_decides_the_others() -> None:
    """So that what they have done stays valid."""
    usual = {"starts": {"reach": (2,)}, "draws": (0,)}
    study = FromPrior(**usual)
    few = FromPrior(**usual, practising={name: study.practising[name] for name in (ITERATED, "filtered_bc")})
    before, now = decisions_of(few), decisions_of(study)
    assert before.items() < now.items()
    assert len({*now.values()}) == len(now), "and no two arms are one"


def test_whatever_practice_begins_with_decides_it() -> None:
    source, other = Source(robot="z1", task="reach"), replace(CLONING, steps=11)
    beginnings = [
        *(Cloned("bc", source, 2, MLP(), cloning) for cloning in (CLONING, other)),
        *(Practised("rounds", source, 2, MLP(), ExpertIteration(rounds=rounds)) for rounds in (1, 2)),
    ]
    trainings = [Continued("dapg", source, 2, MLP(), DAPG(), begun) for begun in beginnings]
    assert len({digest(training.decided_by()) for training in trainings}) == len(beginnings)


@pytest.mark.slow
def test_continued_practice_starts_from_its_clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them, from one clone, once, beside the two that have none."""
    monkeypatch.setattr(practised, "WATCHED_FLIGHTS", 2)
    small = {"steps": 128, "warmup": 64, "cadence": {"log_every": 64}, "trial": {"flights": 0}}
    small |= {"rollout": {"steps": 64, "batch_size": 16}, "critic_hidden": (8,)}
    small |= {"replay": {"batch_size": 16}, "critics": {"count": 2, "hidden": (8,)}, "subset": 1}
    usual = FromPrior().practising
    arms = {
        name: changed(algorithm, {key: value for key, value in small.items() if hasattr(algorithm, key)})
        for name, algorithm in usual.items()
        if isinstance(algorithm, Algorithm)
    }
    small_study = {**SMALL, "practising": arms, "only_from": {}, "watched": 2}
    report = FromPrior(**small_study).run(tmp_path, progress=False)
    flown = {row["arm"]: row["flown"] for row in report.tables["Success"]}
    assert [flown[name] for name in arms] == [128] * 7
    clones = {run.parent for run in tmp_path.glob("training/bc/*/2/*/metrics.jsonl")}
    assert len(clones) == 2, "the one that stands by itself, and the one that all begin with"
    dips = {row["arm"]: row for row in report.tables["Dips"]}
    assert {name for name, row in dips.items() if row["dip"] is None} == {"rlpd", "ppo"}, "nothing to fall below"
    assert dips["jsrl"]["exploring_dip"] is None, "a guide begins its episodes"
    judged = json.loads(
        next(tmp_path.glob("training/bc_ppo/**/config.yaml")).with_name("metrics.jsonl").read_text().splitlines()[0]
    )
    assert (judged["step"], judged["evaluate/episodes"]) == (0, 2), "the prior is flown first"
    assert set(report.figures) == {"by_steps.svg", "by_minutes.svg"}
    kept = report.details["on_the_way"]
    assert len(kept) == 5, "of those that begin with a prior"
    assert all(training["flown"] == [0, 64, 128] for training in kept.values())
    assert {len(training["percent"]) for training in kept.values()} == {3}

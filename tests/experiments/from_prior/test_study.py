"""The study of learning from a prior: a small one runs beside its controls, once, and its targets can be missed."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.core.settings import changed
from aerial_il.evaluation.statistics import mcnemar
from aerial_il.policies.mlp import MLP
from experiments.common import practised
from experiments.common.demonstrations import Source
from experiments.common.practised import Continued, Practised
from experiments.common.record import digest
from experiments.common.stages import Cloned
from experiments.from_prior.study import BEGINNING, CLONE, FromPrior
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

"""The study of learning from a prior: a small one runs beside its controls, once, and its targets can be missed."""

from dataclasses import fields, replace
from typing import Any

from aerial_il import algorithms
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.core import registry
from aerial_il.evaluation.statistics import mcnemar
from aerial_il.policies.mlp import MLP
from experiments.common.demonstrations import Source
from experiments.common.practised import Continued, Practised
from experiments.common.record import digest
from experiments.common.stages import Cloned
from experiments.from_prior.study import BEGINNING, CLONE, FromPrior
from experiments.from_prior_big_four.study import FromPriorBigFour
from experiments.practice.study import Practice

ITERATED = "expert_iteration"
CLONING = BC(steps=10, batch_size=16)


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


def test_practice_starts_from_the_clone_in_the_table() -> None:
    arms = {arm.name: arm.training for arm in FromPrior(starts={"reach": (2,)}, draws=(0,)).all_arms()}
    hiding = digest(arms[BEGINNING].decided_by())
    assert hiding != digest(arms[CLONE].decided_by())
    for training in arms.values():
        if isinstance(training, Continued) and training.prior:
            assert digest(training.prior.decided_by()) == hiding
    own = arms[ITERATED].algorithm
    assert isinstance(own, ExpertIteration)
    default = FromPrior().beginning
    assert (own.training, own.explorer_dropout) == (replace(default, field_dropout=0.0), default.field_dropout), (
        "what makes its own clones makes them in the same way, one with hidden fields and one without"
    )


def decisions_of(study: FromPrior) -> dict[str, str]:
    """Return a digest of all that decides the trainings of each arm."""
    return {f"{arm.name}/{arm.demos}": digest(arm.training.decided_by()) for arm in study.all_arms()}


def test_an_arm_that_is_added_leaves_what_decides_the_others() -> None:
    """So that what they have done stays valid."""
    default = {"starts": {"reach": (2,)}, "draws": (0,)}
    study = FromPrior(**default)
    few = FromPrior(**default, practising={name: study.practising[name] for name in (ITERATED, "filtered_bc")})
    before, now = decisions_of(few), decisions_of(study)
    assert before.items() < now.items()
    assert len({*now.values()}) == len(now), "and no two arms are one"


def test_whatever_practice_begins_with_decides_it() -> None:
    source, other = Source(robot="z1", task="reach"), replace(CLONING, steps=11)
    beginnings = [
        *(Cloned("bc", source, 2, MLP(), cloning) for cloning in (CLONING, other)),
        *(Practised("rounds", source, 2, MLP(), ExpertIteration(rounds=rounds)) for rounds in (1, 2)),
    ]
    trainings = [Continued("dapg", source, 2, MLP(), DAPG(), started) for started in beginnings]
    assert len({digest(training.decided_by()) for training in trainings}) == len(beginnings)


def test_practice_as_shipped_is_what_the_commands_train() -> None:
    """Each method with its defaults, from the clone that it makes by default, on every draw."""
    study = Practice()
    trained = {(arm.name, arm.training.source.draw): arm.training for arm in study.all_arms()}
    for name in study.arms:
        algorithm = registry.get("algorithm", name)()
        for draw in (0, 1, 2):
            training = trained[name, draw]
            assert (training.algorithm, training.policy, training.demos) == (algorithm, MLP(), 10)
            if isinstance(training, Continued):
                assert training.prior.algorithm == algorithm.cloning

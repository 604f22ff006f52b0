"""Policies under conditions: what a disturbance costs each of them, flight by flight, beside its undisturbed twin.

A flight under a condition and its twin have the same seed, and so the same start, objects and goals; they differ in the
disturbance alone. Several trainings of one method are taken as a sample of trainings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.failures import kinds_of
from aerial_il.evaluation.metrics import EpisodeRecord
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval

SAME = ("engine",)  # of provenance: results that differ in it stand in no table together
FLOWN_ALIKE = ("action_level", "controller", "max_steps", "latency", "execution")  # of the environment


@dataclass(frozen=True)
class Condition:
    """A disturbance with a strength, or a tier.

    Attributes:
        label: as it was typed, e.g. ``wind=2``. tier: what is flown, e.g. ``calm+wind:2``.
    """

    label: str
    tier: str

    @staticmethod
    def of(text: str, base: str) -> Condition:
        """Return the condition of ``text``: ``COMPONENT=STRENGTH`` on top of the tier ``base``, or a tier."""
        component, equals, strength = text.partition("=")
        return Condition(text, f"{base}+{component}:{strength}" if equals else text)

    @property
    def folder(self) -> str:
        """The name of a folder for its flights."""
        return self.label.replace("=", "-").replace(":", "-")


@dataclass(frozen=True)
class Row:
    """One method under one condition.

    Attributes:
        method, robot, task, condition: what was flown. trainings: how many of the method there are.
        success, episodes: counts over all trainings. rate: of success.
        ci95: its 95 % interval: Wilson's; of several trainings, by resamples of trainings and seeds, if that is wider.
        difference: to the twins. difference_ci95, p_value, p_adjusted: of it, the last by Holm's method over all rows;
            None of the twins themselves.
        lost, gained: seeds of a single training that only the twin won, and that it did not.
        failures: kind -> count, the most frequent first.
    """

    method: str
    robot: str
    task: str
    condition: str
    trainings: int
    success: int
    episodes: int
    rate: float
    ci95: Interval
    difference: float
    difference_ci95: Interval | None
    p_value: float | None
    p_adjusted: float | None
    lost: tuple[int, ...]
    gained: tuple[int, ...]
    failures: Mapping[str, int]


@dataclass(frozen=True)
class Laboratory:
    """Methods under conditions.

    Attributes:
        base: the label of the condition in which the twins flew. rows: by cell, method and condition.
        rates: method -> condition -> the success rate of each training, over all tasks.
    """

    base: str
    rows: tuple[Row, ...]
    rates: Mapping[str, Mapping[str, tuple[float, ...]]]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def note(self) -> str:
        """How it was compared."""
        tests = sum(row.p_value is not None for row in self.rows)
        several = any(row.trainings > 1 for row in self.rows)
        intervals = "Intervals of several trainings are over trainings and seeds (bootstrap). " if several else ""
        test = "paired permutation over seeds, given these trainings" if several else "exact McNemar test"
        return (
            f"Differences are to the same seeds in {self.base}, by {test}; p is adjusted for {tests} comparisons by "
            f"Holm's method. {intervals}A flight and its twin differ in the disturbance alone."
        )


def compared(flown: Mapping[str, Mapping[str, Sequence[EvaluationResult]]], base: str) -> Laboratory:
    """Compare every condition with the base, method by method.

    Args:
        flown: method -> condition -> one evaluation for each training, all methods' in the same order of conditions.
        base: the condition in which the twins flew.

    Raises:
        InvalidValueError: a method has no twins, trainings or seeds do not match, or results do not belong into one
            table: another version of the engine, another action level.
    """
    _check_alike([each for of in flown.values() for results in of.values() for each in results])
    rows, rates = [], {method: dict[str, tuple[float, ...]]() for method in flown}
    for method, of in flown.items():
        if base not in of:
            raise InvalidValueError(f"{method} was not flown in {base}: there are no twins to compare with.")
        for condition, results in of.items():
            rates[method][condition] = tuple(result.success["rate"] for result in results)
            for cell in dict.fromkeys((result.robot, result.task) for result in results):
                here, twins = (
                    [r for r in each if (r.robot, r.task) == cell] for each in (results, of[base])
                )  # fmt: skip
                rows.append(_row(method, condition, here, None if condition == base else twins))
    tested = [row for row in rows if row.p_value is not None]
    adjusted = iter(statistics.holm([row.p_value for row in tested if row.p_value is not None]))
    corrected = [row if row.p_value is None else replace(row, p_adjusted=next(adjusted)) for row in rows]
    return Laboratory(base, tuple(corrected), rates)


def profile(rates: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the performance profile of runs: thresholds, and the share of runs whose success is at least as high.

    Source:
        R. Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice", NeurIPS 2021,
        section 4.2.
    """
    thresholds = np.linspace(0.0, 1.0, 101)
    return thresholds, (np.asarray(rates)[:, None] >= thresholds - 1e-12).mean(axis=0)


def _row(
    method: str, condition: str, results: Sequence[EvaluationResult], twins: Sequence[EvaluationResult] | None
) -> Row:
    won, first = _outcomes(method, results), results[0]
    count, total = int(won.sum()), won.size
    rng = named_rng(0, "evaluation", "laboratory", method, condition, first.task)
    ci95 = statistics.success_of_trainings(won, rng=rng)
    change, change_ci95, p_value, lost, gained = 0.0, None, None, (), ()
    if twins is not None:
        before = _matched(method, condition, results, twins)
        change = float(won.mean() - before.mean())
        if len(results) > 1:
            each = won.mean(axis=0) - before.mean(axis=0)
            worse, better = (round(float(np.maximum(sign * each, 0.0).sum())) for sign in (-1, 1))
            least = statistics.paired_difference(worse, better, won.shape[1])
            change_ci95 = least.hull(statistics.bootstrap_trainings(won - before, rng=rng))
            p_value = statistics.paired_permutation_test(each, rng=rng)
        else:
            seeds = np.array(first.seeds)
            lost, gained = (tuple(seeds[of].tolist()) for of in (won[0] < before[0], won[0] > before[0]))
            change_ci95 = statistics.paired_difference(len(lost), len(gained), total)
            p_value = statistics.mcnemar(len(lost), len(gained))
    episodes: list[EpisodeRecord] = [episode for result in results for episode in result.episodes]
    cell = {"robot": first.robot, "task": first.task}
    return Row(
        method=method, **cell, condition=condition, trainings=len(results), success=count, episodes=total,
        rate=count / total, ci95=ci95, difference=change, difference_ci95=change_ci95, p_value=p_value,
        p_adjusted=p_value, lost=lost, gained=gained, failures=kinds_of(episodes),
    )  # fmt: skip


def _outcomes(method: str, results: Sequence[EvaluationResult]) -> np.ndarray:
    """Return successes (K, N) of K trainings on the same N seeds, as numbers."""
    for result in results:
        if result.seeds != results[0].seeds:
            raise InvalidValueError(
                f"Trainings of {method} flew other seeds, {_said(results[0])} and {_said(result)}: evaluate them alike."
            )
    return np.array([[float(episode.success) for episode in result.episodes] for result in results])


def _matched(
    method: str, condition: str, results: Sequence[EvaluationResult], twins: Sequence[EvaluationResult]
) -> np.ndarray:
    """Return the outcomes (K, N) of the twins, training by training and seed by seed."""
    if len(results) != len(twins):
        raise InvalidValueError(
            f"{method} has {len(results)} trainings under {condition} and {len(twins)} undisturbed: fly the rest."
        )
    for here, twin in zip(results, twins, strict=True):
        if missing := sorted(set(here.seeds) ^ set(twin.seeds)):
            raise InvalidValueError(
                f"{method} under {condition} and its twins do not match: {len(missing)} seeds, {missing[0]} first, "
                "were flown on one side alone. Fly both over the same seeds."
            )
        if here.seeds != twin.seeds:
            raise InvalidValueError(f"{method} under {condition} and its twins list their seeds in another order.")
    return _outcomes(method, twins)


def _check_alike(results: Sequence[EvaluationResult]) -> None:
    """Refuse results that cannot stand in one table."""
    first = results[0]
    for other in results[1:]:
        pairs = {name: (first.provenance.get(name), other.provenance.get(name)) for name in SAME}
        flown = [result.provenance.get("environment", {}) for result in (first, other)]
        pairs |= {name: (flown[0].get(name), flown[1].get(name)) for name in FLOWN_ALIKE if first.task == other.task}
        for name, (one, another) in pairs.items():
            if one != another:
                raise InvalidValueError(
                    f"{first.policy} and {other.policy} cannot stand in one table: {name} {one} != {another}. "
                    "Evaluate both again under the same settings."
                )


def _said(result: EvaluationResult) -> str:
    return f"{len(result.seeds)} from {result.seeds[0]}"

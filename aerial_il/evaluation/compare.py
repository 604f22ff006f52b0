"""Comparison of two evaluated policies: the difference in success, with an interval and a p-value.

Where both flew the same seeds of the same cell and tier the comparison is paired by seed, which removes the luck of
the draw of episodes; otherwise the two are independent samples.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng
from aerial_il.evaluation import statistics
from aerial_il.evaluation.destination import CONDITIONS
from aerial_il.evaluation.metrics import EpisodeRecord, Metric, metrics_of
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval
from aerial_il.suite.changes import disturbance_changes


@dataclass(frozen=True)
class MetricChange:
    """The mean of one number in a and in b, over the episodes where it exists (in both, if paired).

    Attributes:
        ci95: 95 % interval of the difference of the means, by bootstrap over episodes (over seeds, if paired).
        p_value: two-sided, that both means are one, by permutation.
        p_adjusted: the same by Holm's method for all the numbers that are compared at once.
    """

    key: str
    label: str
    unit: str
    mean_a: float
    mean_b: float
    ci95: Interval
    p_value: float
    p_adjusted: float

    @property
    def difference(self) -> float:
        return self.mean_b - self.mean_a


@dataclass(frozen=True)
class Comparison:
    """Two evaluations of one robot and task side by side.

    Attributes:
        a, b: names of the policies, with their tiers where these differ.
        rate_a, rate_b: success rates.
        difference: ``rate_b - rate_a``.
        ci95: its 95 % interval.
        p_value: two-sided, that both succeed equally often.
        method: the test used.
        paired: whether both flew the same seeds.
        only_a, only_b: seeds on which one succeeded and the other did not (paired only).
        changes: the other numbers; success, the question asked, is not among those for which they are adjusted.
    """

    a: str
    b: str
    rate_a: float
    rate_b: float
    difference: float
    ci95: Interval
    p_value: float
    method: str
    paired: bool
    only_a: tuple[int, ...]
    only_b: tuple[int, ...]
    changes: tuple[MetricChange, ...]

    def __repr__(self) -> str:
        rates = f"{self.a} {100 * self.rate_a:.1f} %, {self.b} {100 * self.rate_b:.1f} %"
        return f"Comparison({rates}, p = {self.p_value:.3g})"

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def summary(self) -> str:
        """The comparison in a few lines for a terminal."""
        lo, hi = (100 * end for end in self.ci95)
        lines = [
            f"success  a {100 * self.rate_a:.1f} %  {self.a}",
            f"         b {100 * self.rate_b:.1f} %  {self.b}",
            f"         b - a = {100 * self.difference:+.1f} points (95 % interval {lo:+.1f} to {hi:+.1f}), "
            f"p = {self.p_value:.3g} ({self.method})",
        ]
        if self.paired:
            lines.append(f"         won by a alone: {len(self.only_a)} seeds, by b alone: {len(self.only_b)}")
        width = max(len(change.key) for change in self.changes)
        lines += [
            f"{c.key:<{width}}  a {c.mean_a:.4g}  b {c.mean_b:.4g}  ({c.difference:+.3g}, 95 % interval "
            f"{c.ci95.lo:+.3g} to {c.ci95.hi:+.3g})  {p_value_text(c.p_value)}, "
            f"adjusted {p_value_text(c.p_adjusted, tests=len(self.changes))}"
            for c in self.changes
        ]
        lines.append(
            f"{len(self.changes)} numbers were tested at once, each by permutation, and adjusted by Holm's method: "
            "chance alone puts any of them below 0.05 in at most 5 % of comparisons. Success is not among them."
        )
        return "\n".join(lines)


def p_value_text(p_value: float, *, tests: int = 1) -> str:
    """Write the p-value of a permutation test, or of the first of ``tests``; its least one is only an upper bound."""
    floor = tests * statistics.smallest_p()
    return f"p <= {floor:.2g}" if p_value <= floor * (1 + 1e-9) else f"p = {p_value:.3g}"


def compare(a: EvaluationResult, b: EvaluationResult) -> Comparison:
    """Compare two evaluations of the same robot and task.

    Raises:
        InvalidValueError: the robots or the tasks differ, so that no difference could be blamed on the policy.
    """
    if (a.robot, a.task) != (b.robot, b.task):
        raise InvalidValueError(
            f"Cannot compare {a.robot}/{a.task} with {b.robot}/{b.task}: evaluate both policies on one robot and task."
        )
    paired = a.tier == b.tier and set(a.seeds) == set(b.seeds)
    by_seed_a, by_seed_b = ({e.seed: e for e in result.episodes} for result in (a, b))
    won_a, won_b = ({seed for seed, e in by.items() if e.success} for by in (by_seed_a, by_seed_b))
    only_a, only_b = (sorted(won_a - won_b), sorted(won_b - won_a)) if paired else ((), ())
    counts = len(won_a), len(a.episodes), len(won_b), len(b.episodes)
    if paired:
        ci95 = statistics.paired_difference(len(only_a), len(only_b), len(a.episodes))
        p_value, method = statistics.mcnemar(len(only_a), len(only_b)), "exact McNemar test, paired by seed"
    else:
        ci95, p_value, method = statistics.newcombe(*counts), statistics.fisher(*counts), "Fisher's exact test"
    metrics = metrics_of((*a.episodes, *b.episodes))
    changes = [c for metric in metrics if (c := _change(metric, by_seed_a, by_seed_b, paired=paired)) is not None]
    adjusted = statistics.holm([change.p_value for change in changes])
    name_a, name_b = (f"{r.policy} ({r.tier})" if a.tier != b.tier else r.policy for r in (a, b))
    rate_a, rate_b = a.success["rate"], b.success["rate"]
    return Comparison(
        a=name_a,
        b=name_b,
        rate_a=rate_a,
        rate_b=rate_b,
        difference=rate_b - rate_a,
        ci95=ci95,
        p_value=p_value,
        method=method,
        paired=paired,
        only_a=tuple(only_a),
        only_b=tuple(only_b),
        changes=tuple(replace(change, p_adjusted=p) for change, p in zip(changes, adjusted, strict=True)),
    )


def other_conditions(a: EvaluationResult, b: EvaluationResult) -> list[str]:
    """Say, besides the tiers that were asked for, what differs between the conditions of two evaluations."""
    engines = [result.provenance.get("engine") or "1" for result in (a, b)]
    notes = [f"a was flown with version {engines[0]} of the engine, b with {engines[1]}."] * (engines[0] != engines[1])
    flown = [result.provenance.get("environment", {}) for result in (a, b)]
    for name in (name for name in CONDITIONS if name != "disturbances"):
        a_has, b_has = (each.get(name) or "none" for each in flown)
        notes += [f"Their {name} differs: {a_has} of a, {b_has} of b."] * (a_has != b_has)
    meant = [each.get("disturbances", {}) for each in flown]
    if a.tier == b.tier and (differing := disturbance_changes(*meant)):
        notes.append(f"Tier {a.tier} did not mean the same in both: {'; '.join(differing)}.")
    return notes


def _change(
    metric: Metric, a: dict[int, EpisodeRecord], b: dict[int, EpisodeRecord], *, paired: bool
) -> MetricChange | None:
    values_a, values_b = ({s: v for s, e in by.items() if (v := metric.value(e)) is not None} for by in (a, b))
    if paired:
        both = [seed for seed in values_a if seed in values_b]
        values_a, values_b = ({seed: values[seed] for seed in both} for values in (values_a, values_b))
    x, y = (np.array(list(values.values()), dtype=float) for values in (values_a, values_b))
    if not x.size or not y.size:
        return None
    rng, resampling = (named_rng(0, "evaluation", use, metric.key) for use in ("compare", "interval"))
    if paired:
        p_value = statistics.paired_permutation_test(y - x, rng=rng)
        ci95 = statistics.bootstrap_mean(y - x, rng=resampling) if len(x) > 1 else statistics.NO_INTERVAL
    else:
        p_value = statistics.permutation_test(x, y, rng=rng)
        ci95 = statistics.bootstrap_difference(x, y, rng=resampling)
    means = float(x.mean()), float(y.mean())
    return MetricChange(metric.key, metric.label, metric.unit, *means, ci95, p_value, p_value)

"""95 % confidence intervals, and tests of whether two numbers differ.

Proportions get exact or score methods, which hold at 0 and 1 and for few episodes; means get the bootstrap and
permutation tests, which assume no distribution. Everything random takes a generator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import stats

from aerial_il.core.errors import InvalidValueError


class Interval(NamedTuple):
    """A 95 % confidence interval; both ends are NaN where there is nothing to estimate from."""

    lo: float
    hi: float

    def hull(self, other: Interval) -> Interval:
        """Return the narrowest interval that holds both."""
        return Interval(min(self.lo, other.lo), max(self.hi, other.hi))


NO_INTERVAL = Interval(math.nan, math.nan)
LEVEL = 0.95  # of confidence, of all intervals
Z = float(stats.norm.ppf((1 + LEVEL) / 2))
RELABELLINGS = 9999  # of a permutation test
MACRO_RESAMPLES = 4000


def wilson(count: int, total: int) -> Interval:
    """Return Wilson's score interval for a proportion.

    Args:
        count: successes, in [0, total].
        total: trials.

    Returns:
        The interval within [0, 1]; its ends are 0 and 1 exactly where no success or no failure was seen.

    Source:
        E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 1927, equation 8.
    """
    if not 0 <= count <= total:
        raise InvalidValueError(f"A count of {count} successes lies outside [0, {total}], the number of trials.")
    if total == 0:
        return NO_INTERVAL
    interval = stats.binomtest(int(count), int(total)).proportion_ci(LEVEL, method="wilson")
    return Interval(float(interval.low), float(interval.high))


def bootstrap_mean(values: np.ndarray, *, rng: np.random.Generator, resamples: int = 2000) -> Interval:
    """Return the percentile bootstrap interval of a mean.

    Args:
        values: (N,) independent observations.
        rng: source of the resamples.
        resamples: number of resampled means.

    Returns:
        The interval; of no width for one observation or equal ones.

    Source:
        B. Efron, "Bootstrap methods: another look at the jackknife", Annals of Statistics 1979.
    """
    values = _finite(values)
    if values.size < 2:  # the library refuses one observation: its resamples are all the same
        return Interval(float(values[0]), float(values[0])) if values.size else NO_INTERVAL
    return _bootstrap((values,), np.mean, rng=rng, resamples=resamples)


def bootstrap_difference(a: np.ndarray, b: np.ndarray, *, rng: np.random.Generator, resamples: int = 2000) -> Interval:
    """Return the percentile bootstrap interval of the difference ``b - a`` of the means of independent samples.

    Args:
        a: (N,) and b: (M,) observations. rng: source of the resamples.
        resamples: number of resampled differences.

    Returns:
        The interval; NaN where either has fewer than two observations, which say nothing of their spread.

    Source:
        B. Efron, "Bootstrap methods: another look at the jackknife", Annals of Statistics 1979.
    """
    a, b = _finite(a), _finite(b)
    if min(a.size, b.size) < 2:
        return NO_INTERVAL
    return _bootstrap((a, b), _difference_of_means, rng=rng, resamples=resamples)


def t_interval(values: np.ndarray) -> Interval:
    """Return Student's interval of a mean of few independent observations, e.g. one number of each training.

    Args:
        values: (N,) independent observations, taken as normal.

    Returns:
        The interval; NaN for fewer than two observations, which say nothing of their spread.
    """
    values = _finite(values)
    if values.size < 2:
        return NO_INTERVAL
    half = stats.t.ppf((1 + LEVEL) / 2, values.size - 1) * values.std(ddof=1) / math.sqrt(values.size)
    return Interval(float(values.mean() - half), float(values.mean() + half))


def bootstrap_macro(counts: Sequence[Sequence[int]], total: int, *, rng: np.random.Generator) -> Interval:
    """Return the interval of a mean success rate over tasks, each flown by policies of one or several training seeds.

    Training seeds are resampled within each task, then the episodes of each; with one seed the episodes alone, so that
    the spread between trainings is not covered. The tasks themselves are given, not drawn. Where all episodes end
    alike, it is Wilson's over all of them.

    Args:
        counts: for each task the successes of each training seed.
        total: episodes that each of them flew.
        rng: source of the resamples.

    Source:
        B. Efron and R. Tibshirani, "An introduction to the bootstrap", 1993, section 8.3 (several levels of sampling).
    """
    if total < 1 or not counts or not all(counts):
        return NO_INTERVAL
    means = np.zeros(MACRO_RESAMPLES)
    for seeds in counts:
        chosen = np.asarray(seeds)[rng.integers(len(seeds), size=(MACRO_RESAMPLES, len(seeds)))]
        means += rng.binomial(total, chosen / total).mean(axis=1) / (total * len(counts))
    tail = (1 - LEVEL) / 2
    lo, hi = np.quantile(means, [tail, 1 - tail])
    found = Interval(float(lo), float(hi))
    if lo < hi:
        return found
    successes = [count for seeds in counts for count in seeds]  # all alike: resamples tell nothing of what else may be
    return found.hull(wilson(sum(successes), total * len(successes)))


def bootstrap_trainings(
    outcomes: np.ndarray, *, rng: np.random.Generator, resamples: int = MACRO_RESAMPLES
) -> Interval:
    """Return the interval of the mean of what several trainings did on the same seeds.

    Trainings and seeds are both resampled, so that the spread of either is covered.

    Args:
        outcomes: (K, N) of K trainings on N seeds: successes, or differences between two conditions.
        rng: source of the resamples.
        resamples: number of them.

    Source:
        A. B. Owen, "The pigeonhole bootstrap", Annals of Applied Statistics 2007.
    """
    trainings, seeds = outcomes.shape
    rows = rng.multinomial(trainings, np.full(trainings, 1 / trainings), size=resamples) / trainings
    columns = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=resamples) / seeds
    means = np.einsum("rk,kn,rn->r", rows, outcomes, columns, optimize=True).clip(outcomes.min(), outcomes.max())
    tail = (1 - LEVEL) / 2
    lo, hi = np.quantile(means, [tail, 1 - tail])
    return Interval(float(lo), float(hi))


def wilson_of_seeds(outcomes: Sequence[Mapping[int, bool]]) -> Interval:
    """Return Wilson's interval for the success of all flights of some policies, of which several share their seeds.

    Two flights of one seed begin alike and tend to end alike: together they say less than two of different seeds. The
    flights count as so many independent ones as have the variance that is seen between seeds, and never as more than
    there are.

    Args:
        outcomes: of each policy, seed -> whether it succeeded.

    Source:
        E. L. Korn and B. I. Graubard, "Confidence intervals for proportions with small expected number of positive
        counts estimated from survey data", Survey Methodology 1998 (effective sample size).
    """
    seeds = sorted({seed for each in outcomes for seed in each})
    won = np.array([sum(each.get(seed, False) for each in outcomes) for seed in seeds], float)
    flown = np.array([sum(seed in each for each in outcomes) for seed in seeds], float)
    count, total = float(won.sum()), float(flown.sum())
    if total == 0:
        return NO_INTERVAL
    rate = count / total
    effective = total
    if 0.0 < rate < 1.0 and len(seeds) > 1:
        between = float(np.sum((won - rate * flown) ** 2)) / total**2
        effective = min(total, rate * (1.0 - rate) / between) if between > 0.0 else total
    return wilson_of_rate(rate, effective)


def wilson_of_rate(rate: float, total: float) -> Interval:
    """Return Wilson's interval of a rate in a number of trials that need not be whole, nor the successes among them."""
    share = Z * Z / total
    half = Z * math.sqrt(rate * (1.0 - rate) / total + share / (4.0 * total)) / (1.0 + share)
    centre = (rate + 0.5 * share) / (1.0 + share)
    return Interval(max(0.0, centre - half) if rate > 0.0 else 0.0, min(1.0, centre + half) if rate < 1.0 else 1.0)


def success_of_trainings(outcomes: np.ndarray, *, rng: np.random.Generator) -> Interval:
    """Return the interval of the success rate of trainings that flew the same seeds.

    Args:
        outcomes: (K, N) successes of K trainings on N seeds. rng: source of the resamples.

    Returns:
        Wilson's over the seeds, since flights of one seed are not independent; of several trainings at least as wide as
        :func:`bootstrap_trainings`, which has no width where all outcomes are equal.
    """
    trainings, seeds = outcomes.shape
    interval = wilson_of_rate(float(outcomes.mean()), seeds)
    return interval.hull(bootstrap_trainings(outcomes, rng=rng)) if trainings > 1 else interval


def newcombe(count_a: int, total_a: int, count_b: int, total_b: int) -> Interval:
    """Return the interval of the difference ``b - a`` of two independent proportions.

    Source:
        R. G. Newcombe, "Interval estimation for the difference between independent proportions", Statistics in
        Medicine 1998, method 10: the Wilson intervals of both, combined by squares.
    """
    if total_a == 0 or total_b == 0:
        return NO_INTERVAL
    rate_a, rate_b = count_a / total_a, count_b / total_b
    a, b = wilson(count_a, total_a), wilson(count_b, total_b)
    below = math.hypot(rate_b - b.lo, a.hi - rate_a)
    above = math.hypot(b.hi - rate_b, rate_a - a.lo)
    return Interval(rate_b - rate_a - below, rate_b - rate_a + above)


def paired_difference(only_a: int, only_b: int, total: int) -> Interval:
    """Return the interval of the difference ``b - a`` of two proportions seen on the same trials.

    Args:
        only_a, only_b: trials on which one succeeded and the other did not.
        total: all trials.

    Source:
        D. G. Bonett and R. M. Price, "Adjusted Wald confidence interval for a difference of binomial proportions
        based on paired data", Journal of Educational and Behavioral Statistics 2012, equation 5.
    """
    if total == 0:
        return NO_INTERVAL
    p_a, p_b = (only_a + 1) / (total + 2), (only_b + 1) / (total + 2)
    half = Z * math.sqrt((p_a + p_b - (p_b - p_a) ** 2) / (total + 2))
    return Interval(max(-1.0, p_b - p_a - half), min(1.0, p_b - p_a + half))


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the two-sided exact p-value that two policies succeed equally often on the same seeds.

    Source:
        Q. McNemar, Psychometrika 1947, with the exact binomial distribution of the discordant pairs.
    """
    discordant = only_a + only_b
    return 1.0 if discordant == 0 else float(stats.binomtest(only_a, discordant, 0.5).pvalue)


def fisher(count_a: int, total_a: int, count_b: int, total_b: int) -> float:
    """Return the two-sided exact p-value that two independent proportions are equal (Fisher 1922)."""
    table = [[count_a, total_a - count_a], [count_b, total_b - count_b]]
    result: Any = stats.fisher_exact(table)
    return float(result.pvalue)


def permutation_test(a: np.ndarray, b: np.ndarray, *, rng: np.random.Generator, resamples: int = RELABELLINGS) -> float:
    """Return the two-sided p-value that two independent samples have one mean.

    Args:
        a, b: (Na,) and (Nb,) observations.
        rng: source of the relabellings.
        resamples: number of random relabellings; where there are fewer in all, each is tried once and p is exact.

    Returns:
        Twice the smaller one-sided p-value, at least :func:`smallest_p` where relabellings are random; 1 where a sample
        is a single observation, which shows no spread; NaN where one is empty.

    Source:
        B. Phipson and G. K. Smyth, "Permutation p-values should never be zero", 2010.
    """
    a, b = _finite(a), _finite(b)
    if a.size == 0 or b.size == 0:
        return math.nan
    if min(a.size, b.size) == 1:
        return 1.0
    return _permuted((a, b), _difference_of_means, "independent", rng=rng, resamples=resamples)


def paired_permutation_test(
    differences: np.ndarray, *, rng: np.random.Generator, resamples: int = RELABELLINGS
) -> float:
    """Return the two-sided p-value that paired differences (N,) are symmetric about zero, by flips of their signs.

    The flips are random or all of them, and p is bounded, as in :func:`permutation_test`.
    """
    differences = _finite(differences)
    if differences.size < 2:
        return 1.0 if differences.size else math.nan
    return _permuted((differences,), np.mean, "samples", rng=rng, resamples=resamples)


def smallest_p() -> float:
    """Return the least two-sided p-value that random relabellings can give: none was as extreme, on either side."""
    return 2 / (RELABELLINGS + 1)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for all being tested at once, in the same order.

    Calling every adjusted value below 0.05 a difference errs in any of them in at most 5 % of such comparisons.

    Source:
        S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 1979.
    """
    order = np.argsort(p_values)
    scaled = np.asarray(p_values, dtype=float)[order] * np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted.tolist()


def _bootstrap(
    samples: tuple[np.ndarray, ...], statistic: Callable[..., Any], *, rng: np.random.Generator, resamples: int
) -> Interval:  # fmt: skip
    """Return the percentile interval of a statistic of one or several independent samples."""
    batch = _batch(sum(sample.size for sample in samples))
    drawn = stats.bootstrap(
        samples, statistic, n_resamples=resamples, batch=batch, confidence_level=LEVEL, method="percentile", rng=rng
    )
    return Interval(float(drawn.confidence_interval.low), float(drawn.confidence_interval.high))


def _permuted(
    samples: tuple[np.ndarray, ...], statistic: Callable[..., Any], kind: Literal["independent", "samples"], *,
    rng: np.random.Generator, resamples: int,
) -> float:  # fmt: skip
    """Return the two-sided p-value of a statistic of one or several samples under permutations of a kind."""
    batch = _batch(sum(sample.size for sample in samples))
    test = stats.permutation_test(
        samples, statistic, permutation_type=kind, vectorized=True, n_resamples=resamples, batch=batch, rng=rng
    )
    return float(test.pvalue)


def _batch(size: int) -> int:
    """Return how many resamples of ``size`` numbers are drawn at once: a million numbers, to bound memory."""
    return max(1, 1_000_000 // size)


def _difference_of_means(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
    return b.mean(axis) - a.mean(axis)


def _finite(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=float).ravel()
    if not np.all(np.isfinite(values)):
        raise InvalidValueError(f"Observation {int(np.argmin(np.isfinite(values)))} of {values.size} is not finite.")
    return values

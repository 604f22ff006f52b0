"""Intervals and tests against published values, exact enumeration and their own promises."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation import statistics

counts = st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts)
def test_wilson_equals_scipy_and_holds_the_estimate(pair: tuple[int, int]) -> None:
    count, total = pair
    lo, hi = statistics.wilson(count, total)
    reference = stats.binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert (lo, hi) == pytest.approx((reference.low, reference.high), abs=1e-12)
    assert 0 <= lo <= count / total <= hi <= 1


@given(counts)
def test_wilson_mirrors_failures(pair: tuple[int, int]) -> None:
    count, total = pair
    lo, hi = statistics.wilson(count, total)
    mirrored = statistics.wilson(total - count, total)
    assert (1 - hi, 1 - lo) == pytest.approx(tuple(mirrored), abs=1e-12)


def test_wilson_of_a_published_example() -> None:
    assert statistics.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)  # Newcombe 1998, table I


def test_wilson_without_trials_says_nothing_and_refuses_nonsense() -> None:
    assert all(math.isnan(end) for end in statistics.wilson(0, 0))
    with pytest.raises(InvalidValueError, match=r"5 successes.*\[0, 4\]"):
        statistics.wilson(5, 4)


def test_flights_of_one_seed_count_as_fewer_where_they_end_alike() -> None:
    rng = np.random.default_rng(3)
    apart = [dict(enumerate(rng.random(100) < 0.8)) for _ in range(3)]
    count = sum(map(sum, (each.values() for each in apart)))
    assert statistics.wilson_of_seeds(apart[:1]) == pytest.approx(statistics.wilson(sum(apart[0].values()), 100))
    lo, hi = statistics.wilson_of_seeds(apart)
    narrow = statistics.wilson(count, 300)
    assert lo <= narrow.lo + 1e-9
    assert hi >= narrow.hi - 1e-9
    alike = statistics.wilson_of_seeds(apart[:1] * 3)
    assert alike == pytest.approx(statistics.wilson(sum(apart[0].values()), 100)), "thrice the same flights"
    assert statistics.wilson_of_seeds([dict.fromkeys(range(100), True)] * 3) == pytest.approx(
        statistics.wilson(300, 300)
    )
    assert all(math.isnan(end) for end in statistics.wilson_of_seeds([{}]))


def test_where_seeds_are_hard_or_easy_95_of_100_intervals_hold_the_rate() -> None:
    """Three policies fly 100 seeds each of which is won with a chance of its own."""
    rng, held, naive = np.random.default_rng(4), [], []
    for _ in range(1000):
        chances = rng.beta(1.6, 0.4, 100)  # 0.8 in the mean
        flown = rng.random((3, 100)) < chances
        lo, hi = statistics.wilson_of_seeds([dict(enumerate(each)) for each in flown])
        held.append(lo <= 0.8 <= hi)
        lo, hi = statistics.wilson(int(flown.sum()), 300)
        naive.append(lo <= 0.8 <= hi)
    assert np.mean(held) > 0.93
    assert np.mean(naive) < 0.9


def test_a_failure_among_trainings_is_not_rounded_away() -> None:
    """Of 100 flights on 50 seeds one was lost: that says less for them than if none had been."""
    outcomes = np.ones((2, 50))
    outcomes[0, 0] = 0
    rng = np.random.default_rng(0)
    lo, _ = statistics.success_of_trainings(outcomes, rng=rng)
    assert lo < statistics.success_of_trainings(np.ones((2, 50)), rng=rng).lo
    assert lo == pytest.approx(0.911, abs=5e-4)


def test_a_mean_over_tasks_in_which_all_is_won_has_an_interval() -> None:
    rng = np.random.default_rng(0)
    assert statistics.bootstrap_macro([[100]] * 10, 100, rng=rng) == statistics.wilson(1000, 1000)
    assert statistics.bootstrap_macro([[0], [0]], 100, rng=rng) == statistics.wilson(0, 200)


def test_newcombe_of_a_published_example() -> None:
    interval = statistics.newcombe(48, 80, 56, 70)  # Newcombe 1998, table II, row (a), method 10, sign turned
    assert interval == pytest.approx((0.0524, 0.3339), abs=5e-5)


@given(counts, counts)
def test_newcombe_holds_the_difference_and_mirrors(a: tuple[int, int], b: tuple[int, int]) -> None:
    lo, hi = statistics.newcombe(*a, *b)
    assert lo <= b[0] / b[1] - a[0] / a[1] <= hi
    assert statistics.newcombe(*b, *a) == pytest.approx((-hi, -lo), abs=1e-12)


def test_paired_difference_covers_the_truth() -> None:
    """Of 2000 experiments with a true difference of 0.1, about 95 % of the intervals hold it."""
    rng, total = np.random.default_rng(0), 100
    draws = rng.multinomial(total, [0.15, 0.25, 0.60], size=2000)
    held = [lo <= 0.1 <= hi for lo, hi in (statistics.paired_difference(a, b, total) for a, b, _ in draws)]
    assert 0.93 < np.mean(held) < 0.98


def test_mcnemar_is_the_exact_binomial() -> None:
    assert statistics.mcnemar(0, 0) == 1.0
    assert statistics.mcnemar(0, 6) == pytest.approx(2 * 0.5**6)
    assert statistics.mcnemar(3, 9) == pytest.approx(2 * sum(math.comb(12, k) for k in range(4)) / 2**12)


def test_fisher_of_the_tea_tasting_lady() -> None:
    assert statistics.fisher(3, 4, 1, 4) == pytest.approx(34 / 70)


def test_bootstrap_covers_the_mean_of_a_skewed_sample() -> None:
    rng = np.random.default_rng(1)
    samples = rng.exponential(2.0, size=(200, 60))
    held = [lo <= 2.0 <= hi for lo, hi in (statistics.bootstrap_mean(s, rng=rng, resamples=400) for s in samples)]
    assert 0.87 < np.mean(held) <= 0.98


def test_bootstrap_of_equal_values_has_no_width() -> None:
    assert statistics.bootstrap_mean(np.full(5, 3.0), rng=np.random.default_rng(0)) == (3.0, 3.0)
    values = np.arange(10.0)
    first, second = (statistics.bootstrap_mean(values, rng=np.random.default_rng(7)) for _ in range(2))
    assert first == second


def test_bootstrap_covers_the_difference_of_two_means() -> None:
    rng, held = np.random.default_rng(1), []
    for _ in range(200):
        a, b = rng.exponential(2.0, 60), rng.normal(3.0, 1.0, 30)
        lo, hi = statistics.bootstrap_difference(a, b, rng=rng, resamples=400)
        held.append(lo <= 1.0 <= hi)
    assert 0.87 < np.mean(held) <= 0.98
    lo, hi = statistics.bootstrap_difference(np.ones(1), np.ones(9), rng=rng)
    assert np.isnan([lo, hi]).all()


def test_bootstrap_refuses_nan_by_index() -> None:
    with pytest.raises(InvalidValueError, match="Observation 1 of 2"):
        statistics.bootstrap_mean(np.array([0.0, np.nan]), rng=np.random.default_rng(0))


def test_permutation_test_agrees_with_full_enumeration() -> None:
    a, b = np.array([1.0, 2.0, 4.0, 7.0]), np.array([5.0, 6.0, 9.0, 12.0])
    pooled, observed = np.concatenate([a, b]), abs(a.mean() - b.mean())
    splits = [set(s) for s in itertools.combinations(range(8), 4)]
    far = [abs(pooled[list(s)].mean() - pooled[list(set(range(8)) - s)].mean()) >= observed - 1e-12 for s in splits]
    p_value = statistics.permutation_test(a, b, rng=np.random.default_rng(0))
    assert p_value == pytest.approx(np.mean(far))


@settings(max_examples=20)
@given(st.lists(st.floats(-5, 5), min_size=1, max_size=8))
def test_paired_permutation_is_a_probability_without_sign(values: list[float]) -> None:
    differences = np.array(values)
    p_value, mirrored = (
        statistics.paired_permutation_test(sign * differences, rng=np.random.default_rng(0), resamples=99)
        for sign in (1, -1)
    )
    assert 0 < p_value <= 1
    assert p_value == pytest.approx(mirrored)


def test_permutation_tests_are_uniform_under_no_difference() -> None:
    rng = np.random.default_rng(2)
    draws = [statistics.permutation_test(*rng.normal(size=(2, 10)), rng=rng, resamples=99) for _ in range(300)]
    assert np.mean(np.array(draws) <= 0.05) < 0.09
    assert 0.4 < np.mean(draws) < 0.6


def test_holm_of_a_worked_example_keeps_order_and_never_falls() -> None:
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.4, 0.9]) == [0.8, 0.9]
    assert statistics.holm([]) == []


def test_holm_errs_in_one_of_twenty_families() -> None:
    p_values = np.random.default_rng(3).uniform(size=(2000, 11))
    assert np.mean(p_values.min(axis=1) < 0.05) > 0.4
    assert np.mean([min(statistics.holm(family.tolist())) < 0.05 for family in p_values]) < 0.06


def test_small_samples_are_enumerated() -> None:
    a, b = np.array([1.0, 2.0, 3.0]), np.array([10.0, 11.0, 12.0])
    assert statistics.permutation_test(a, b, rng=np.random.default_rng(0)) == pytest.approx(2 / math.comb(6, 3))
    assert statistics.permutation_test(a[:1], b, rng=np.random.default_rng(0)) == 1
    assert statistics.paired_permutation_test(b, rng=np.random.default_rng(0)) == pytest.approx(2 / 2**3)


def test_t_interval_equals_scipy() -> None:
    values = np.array([0.69, 0.81, 0.74])
    reference = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert statistics.t_interval(values) == pytest.approx((reference.low, reference.high), rel=1e-9)
    assert all(map(math.isnan, statistics.t_interval(values[:1])))
    assert statistics.t_interval(np.ones(3)) == (1.0, 1.0)

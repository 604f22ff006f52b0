"""Several evaluations in one ranking, each against the best, with p-values adjusted for how many there are."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from aerial_il.evaluation import statistics
from aerial_il.evaluation.compare import Comparison, compare
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import Interval


@dataclass(frozen=True)
class Place:
    """One evaluation among several.

    Attributes:
        name: its folder. policy, tier: who flew, and where. success, episodes: counts.
        rate, ci95: success rate and its 95 % interval (Wilson).
        difference: to the best one's rate. difference_ci95: its 95 % interval; None for the best itself.
        p_value, p_adjusted: two-sided, that both succeed equally often; the second by Holm's method over all that are
            compared with the best. None for the best itself.
    """

    name: str
    policy: str
    tier: str
    success: int
    episodes: int
    rate: float
    ci95: Interval
    difference: float
    difference_ci95: Interval | None
    p_value: float | None
    p_adjusted: float | None


@dataclass(frozen=True)
class Ranking:
    """Evaluations of one robot and task, the best first.

    Attributes:
        places: in order. methods: the tests that were used.
    """

    places: tuple[Place, ...]
    methods: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def rows(self) -> list[dict[str, str]]:
        """Return the ranking as rows of texts: rates, differences and intervals in per cent."""
        return [_row(number, place) for number, place in enumerate(self.places, 1)]

    @property
    def note(self) -> str:
        """How it was compared."""
        count = len(self.places) - 1
        return (
            f"Differences are to the first, tested by {' and '.join(self.methods)}; p is adjusted for {count} "
            "comparisons by Holm's method. The first was chosen by these very flights: its own rate is flattered."
        )


def rank(results: Mapping[str, EvaluationResult]) -> Ranking:
    """Rank evaluations by their success.

    Args:
        results: name -> evaluation, of one robot and task; at least two.

    Raises:
        InvalidValueError: the robots or the tasks differ.
    """
    order = sorted(results, key=lambda name: -results[name].success["rate"])
    best = results[order[0]]
    pairs = {name: compare(best, results[name]) for name in order[1:]}
    adjusted = dict(zip(pairs, statistics.holm([pair.p_value for pair in pairs.values()]), strict=True))
    places = tuple(_place(name, results[name], pairs.get(name), adjusted.get(name)) for name in order)
    return Ranking(places, tuple(dict.fromkeys(pair.method for pair in pairs.values())))


def _place(name: str, result: EvaluationResult, pair: Comparison | None, p_adjusted: float | None) -> Place:
    won, flown = result.success["count"], len(result.episodes)
    return Place(
        name=name,
        policy=result.policy,
        tier=result.tier,
        success=won,
        episodes=flown,
        rate=won / flown,
        ci95=statistics.wilson(won, flown),
        difference=pair.difference if pair else 0.0,
        difference_ci95=pair.ci95 if pair else None,
        p_value=pair.p_value if pair else None,
        p_adjusted=p_adjusted,
    )


def _row(number: int, place: Place) -> dict[str, str]:
    low, high = (100 * end for end in place.ci95)
    row = {
        "rank": str(number),
        "evaluation": place.name,
        "tier": place.tier,
        "success": f"{place.success} of {place.episodes}",
        "rate": f"{100 * place.rate:.1f} % ({low:.1f} to {high:.1f})",
    }
    if place.difference_ci95 is None or place.p_adjusted is None:
        return {**row, "difference": "", "p": ""}
    less, more = (100 * end for end in place.difference_ci95)
    return {
        **row,
        "difference": f"{100 * place.difference:+.1f} ({less:+.1f} to {more:+.1f})",
        "p": f"{place.p_adjusted:.2g}",
    }

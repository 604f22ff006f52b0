"""What is wanted of methods that practise from a start, and which of them reach it by their own doing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from experiments.common.report import Row, Target
from experiments.from_prior.gains import is_gain

LONGEST_MINUTES = 180.0


@dataclass(frozen=True)
class Wanted:
    """What is wanted from a start, wherever it was practised: % in one tier and in a ``harder`` one, of ``methods``."""

    percent: float
    harder: float = 85.0
    methods: int = 3

    def target(self, start: str, rows: Sequence[Row], gains: Sequence[Row], *, tiers: tuple[str, str]) -> Target:
        """Return the target that so many methods reach it in time.

        One that begins with a policy that has reached it already counts only if it has gained on that, significantly,
        in one of the tiers: otherwise whoever learns nothing would count.

        Args:
            start: what they begin with, for people. rows: success of the methods in both tiers. gains: of those that
                begin with a policy, over it, in both tiers. tiers: the first, and the harder one.
        """
        arms = list(dict.fromkeys(row["arm"] for row in rows))
        found = {arm: _in(tiers, arm, rows, "percent") for arm in arms}
        reached = [arm for arm in arms if self._is_reached(found[arm]) and _in_time(arm, rows)]
        counted = [arm for arm in reached if self._is_own(arm, gains, tiers)]
        what = (
            f"{start}: methods with {self.percent:g} % in {tiers[0]} and {self.harder:g} % in {tiers[1]} within 3 hours"
        )
        spread = ", ".join(f"{arm} {found[arm][0]:g} and {found[arm][1]:g} %" for arm in arms)
        idle = [arm for arm in reached if arm not in counted]
        said = f"; no significant gain on what they begin with, and not counted: {', '.join(idle)}" if idle else ""
        return Target(what, "at least", self.methods, len(counted), "methods", spread + said)

    def _is_reached(self, percent: Sequence[float]) -> bool:
        return percent[0] >= self.percent and percent[1] >= self.harder

    def _is_own(self, arm: str, gains: Sequence[Row], tiers: tuple[str, str]) -> bool:
        own = [row for row in gains if row["arm"] == arm]
        return not own or not self._is_reached(_in(tiers, arm, own, "before")) or any(map(is_gain, own))


def targets_from(
    wanted: Mapping[tuple[str, int], Wanted], rows: Sequence[Row], gains: Sequence[Row], *, tiers: tuple[str, str]
) -> Iterator[Target]:
    """Yield one target for each start, task and number of demonstrations, from which methods were trained."""
    for (task, demos), asked in wanted.items():
        ours, added = ([r for r in every if (r["task"], r["demos"]) == (task, demos)] for every in (rows, gains))
        if ours:
            yield asked.target(f"{task} from {demos}", ours, added, tiers=tiers)


def _in(tiers: tuple[str, str], arm: str, rows: Sequence[Row], column: str) -> list[float]:
    """Return a number of an arm in both tiers."""
    return [next(row[column] for row in rows if (row["arm"], row["tier"]) == (arm, tier)) for tier in tiers]


def _in_time(arm: str, rows: Sequence[Row]) -> bool:
    return all(row["minutes"] <= LONGEST_MINUTES for row in rows if row["arm"] == arm)

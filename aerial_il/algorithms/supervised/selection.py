"""Selection of the demonstrations that a policy learns from, and the weight of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from aerial_il.core.checks import make_tuples, require_choice
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode

Quality = Literal["duration", "smoothness", "reward"]


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which demonstrations are learned from, and how much each counts.

    Attributes:
        operators: who flew, as the recordings name them (``expert``, a person, a policy's folder); empty for everyone.
        quality: what makes a demonstration good: a short ``duration``, ``smoothness`` (little jerk in its actions) or
            a high mean ``reward``.
        keep: share of the demonstrations that is kept, the best ones.
        sharpness: how much more the better ones count: from the best to the worst the weight falls to
            ``exp(-sharpness)``, evenly over the ranks.
        operator_weights: who flew -> how much their demonstrations count, where it is not 1.
        failures: how much a flight counts that failed; 0 leaves them out. Those that an expert has labelled, as in
            DAgger, count as much as others.
    """

    operators: tuple[str, ...]
    quality: Quality
    keep: float
    sharpness: float
    operator_weights: Mapping[str, float]
    failures: float

    def __post_init__(self) -> None:
        make_tuples(self)
        require_choice(self, "quality", Quality)
        if not 0 < self.keep <= 1:
            raise InvalidValueError(f"keep is {self.keep}; it must lie in (0, 1], the share that is kept.")
        for name in ("sharpness", "failures"):
            if not 0 <= getattr(self, name) < np.inf:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; it must not be negative.")
        for name, weight in self.operator_weights.items():
            if not 0 < weight < np.inf:
                raise InvalidValueError(f"The weight of {name} is {weight}; it must be positive. See operators.")

    def apply(
        self, demos: Sequence[Episode], weights: Sequence[float] | None = None
    ) -> tuple[list[Episode], np.ndarray]:
        """Return the demonstrations that count, in their order, and the weight of each (E,).

        Args:
            demos: to choose from. weights: of each, before that.

        Raises:
            InvalidValueError: there are not as many weights as demonstrations.
            UnknownNameError: an operator is named who flew none of them.
        """
        given = np.ones(len(demos)) if weights is None else np.asarray(weights, float)
        if given.shape != (len(demos),):
            raise InvalidValueError(f"There are {len(demos)} demonstrations to choose from and {given.size} weights.")
        flew = {operator_of(demo) for demo in demos}
        for name in (*self.operators, *self.operator_weights):
            if name not in flew:
                raise UnknownNameError("operator", name, sorted(flew), "That is who flew these demonstrations.")
        chosen = [i for i, demo in enumerate(demos) if not self.operators or operator_of(demo) in self.operators]
        demos, given = [demos[i] for i in chosen], given[chosen]
        ranks = _ranks(demos, self.quality)
        kept = [i for i in range(len(demos)) if ranks[i] < max(1, round(self.keep * len(demos)))]
        worst = max(1, len(kept) - 1)
        by_rank = np.exp(-self.sharpness * ranks[kept] / worst)
        by_operator = [self.operator_weights.get(operator_of(demos[i]), 1.0) for i in kept]
        by_success = [1.0 if demos[i].success else self.failures for i in kept]
        return [demos[i] for i in kept], by_rank * np.array(by_operator) * np.array(by_success) * given[kept]


def operator_of(demo: Episode) -> str:
    """Return who flew, as the recording names them."""
    return str(demo.provenance.get("policy", "unknown"))


def _ranks(demos: Sequence[Episode], quality: Quality) -> np.ndarray:
    """Return the rank (E,) of each demonstration, the best being 0; equally good ones keep their order.

    Failures come last: that a flight which crashed was short speaks for nothing.
    """
    badness = {
        "duration": lambda demo: len(demo) * demo.spec.control_dt_s,
        "smoothness": lambda demo: roughness(demo),
        "reward": lambda demo: -float(np.mean(demo.rewards)),
    }
    failed, bad = [not demo.success for demo in demos], [badness[quality](demo) for demo in demos]
    ranks = np.empty(len(demos), int)
    ranks[np.lexsort((bad, failed))] = np.arange(len(demos))
    return ranks


def roughness(demo: Episode) -> float:
    """Return the root mean square third difference of the actions, each element as a share of its range.

    Switches and turns count; in the ``jerk`` of :mod:`aerial_il.data.quality` they do not.
    """
    scaled = demo.executed_actions / (demo.spec.action.high - demo.spec.action.low)
    return float(np.sqrt(np.mean(np.diff(scaled, n=3, axis=0) ** 2))) if len(demo) > 3 else 0.0

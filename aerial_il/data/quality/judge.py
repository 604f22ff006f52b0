"""Read a dataset once, measure each episode, and say which are suspect and why."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.quality.alone import idle, jerk, saturation
from aerial_il.data.quality.consistency import consistency
from aerial_il.data.quality.duplicates import repeated
from aerial_il.data.quality.information import information
from aerial_il.data.quality.trace import Trace, normalised, trace_of

ALONE: Mapping[str, Callable[[Episode], float]] = {"idle": idle, "jerk": jerk, "saturation": saturation}
FEWEST = 8  # episodes, for a usual one to be known


@dataclass(frozen=True)
class Limit:
    """From where on a value is suspect: all three must be exceeded.

    Attributes:
        spreads: above the median, in standard deviations as the median absolute deviation tells them.
        least: above the median. share: above the median, as a share of it.
    """

    spreads: float
    least: float = 0.0
    share: float = 0.0

    def exceeded(self, values: np.ndarray) -> np.ndarray:
        """Return which of the values (E,) are suspect, (E,) bool."""
        median = np.median(values)
        spread = 1.4826 * np.median(np.abs(values - median))
        return values - median > max(self.spreads * spread, self.least, self.share * median)


LIMITS: Mapping[str, Limit] = {
    "idle": Limit(6.0, least=0.10),
    "jerk": Limit(6.0, share=1.0),
    "saturation": Limit(6.0, least=0.05),
    "inconsistency": Limit(5.0, share=1.6),
    "lag_s": Limit(5.0, least=0.12),
}


@dataclass(frozen=True)
class Judgement:
    """What measures say of a dataset.

    Attributes:
        columns: measure -> uid -> value. ``suspect`` has the reasons, with commas between; empty for none.
        kept: whether they were written into the dataset.
    """

    columns: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    kept: bool = False

    @property
    def suspects(self) -> dict[str, str]:
        """Name of each suspect episode -> why."""
        return {uid: str(why) for uid, why in self.columns["suspect"].items() if why}


def judge(episodes: Iterable[Episode]) -> Judgement:
    """Measure every episode.

    Args:
        episodes: of one environment, each read once. What is kept of them takes some kilobytes each. Without states, as
            of pictures alone, actions are compared with nothing.

    Raises:
        InvalidValueError: they are too few for a usual one to be known.
    """
    alone: dict[str, dict[str, float]] = {name: {} for name in ALONE}
    traces = []
    for episode in episodes:
        traces.append(trace_of(episode))
        for name, measure in ALONE.items():
            alone[name][episode.uid] = measure(episode)
    if len(traces) < FEWEST:
        raise InvalidValueError(f"{len(traces)} episodes are too few to say which are unusual: it takes {FEWEST}.")
    traces = normalised(traces)
    values = alone | (_compared(traces) if traces[0].states.size and traces[0].actions.size else {})
    again = repeated(traces)
    uids = [trace.uid for trace in traces]
    exceeded = {
        name: limit.exceeded(np.array([values[name][uid] for uid in uids]))
        for name, limit in LIMITS.items()
        if name in values
    }
    why = {uid: [name for name, found in exceeded.items() if found[i]] for i, uid in enumerate(uids)}
    reasons = {uid: ", ".join(found + ["repeated"] * (uid in again)) for uid, found in why.items()}
    rounded = {name: {uid: round(value, 5) for uid, value in column.items()} for name, column in values.items()}
    return Judgement({**rounded, "repeats": {uid: again.get(uid, "") for uid in uids}, "suspect": reasons})


def _compared(traces: Sequence[Trace]) -> dict[str, dict[str, float]]:
    """Return the measures that hold an episode's actions against its states and those of others."""
    acts = consistency(traces)
    return {
        "inconsistency": {uid: found.missed for uid, found in acts.items()},
        "lag_s": {uid: found.lag_s for uid, found in acts.items()},
        "information": information(traces),
    }

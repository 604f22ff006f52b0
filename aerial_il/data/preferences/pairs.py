"""Pairs of segments of flights, and which of the two is preferred."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng

Preferred = Literal["left", "right", "equal"]
Judge = Literal["script", "hand"]
TRIES = 1_000  # for each pair, before there are said to be no more


class Segment(NamedTuple):
    """A piece of a flight.

    Attributes:
        uid: of the episode. first: its first step. length: its number of steps.
    """

    uid: str
    first: int
    length: int


Pair = tuple[Segment, Segment]


@dataclass(frozen=True)
class Preference:
    """What was said of two segments.

    Attributes:
        left, right: the segments. preferred: the better one, or ``equal``. by: who says so.
    """

    left: Segment
    right: Segment
    preferred: Preferred
    by: Judge

    def __post_init__(self) -> None:
        for name, value, valid in (("preferred", self.preferred, Preferred), ("by", self.by, Judge)):
            if value not in get_args(valid):
                raise InvalidValueError(f"{name} is {value!r}. Valid: {', '.join(get_args(valid))}.")
        for segment in self.pair:
            if min(segment.first, segment.length - 1) < 0:
                raise InvalidValueError(f"{segment} begins before its episode, or has no steps.")

    @property
    def pair(self) -> Pair:
        """Both segments."""
        return self.left, self.right


def draw_pairs(lengths: Mapping[str, int], count: int, *, length: int, seed: int) -> list[Pair]:
    """Draw pairs of segments of different episodes, each pair once; all episodes count alike, so that long ones,
    which are mostly failures, are not compared with each other alone.

    Args:
        lengths: uid -> steps of each episode; those shorter than a segment have none.
        count: pairs. length: steps of a segment. seed: decides the pairs; the first of many are those of few.

    Raises:
        InvalidValueError: fewer than two episodes are long enough, or there are not so many pairs.
    """
    starts = {uid: steps - length + 1 for uid, steps in lengths.items() if steps >= length}
    if len(starts) < 2:
        longest = max(lengths.values(), default=0)
        raise InvalidValueError(
            f"{len(starts)} of {len(lengths)} episodes have the {length} steps of a segment; it takes 2. The longest "
            f"has {longest}."
        )
    rng, uids, found = named_rng(seed, "pairs"), list(starts), dict[Pair, None]()
    for _ in range(TRIES * count):
        if len(found) == count:
            break
        chosen = [uids[int(i)] for i in rng.choice(len(uids), size=2, replace=False)]
        left, right = (Segment(uid, int(rng.integers(starts[uid])), length) for uid in chosen)
        if (right, left) not in found:
            found[left, right] = None
    if len(found) == count:
        return list(found)
    raise InvalidValueError(f"There are {len(found)} pairs of segments of {length} steps; {count} were asked for.")


def flip(preferred: Preferred) -> Preferred:
    """Return the opposite of a preference."""
    opposites: dict[Preferred, Preferred] = {"left": "right", "right": "left", "equal": "equal"}
    return opposites[preferred]

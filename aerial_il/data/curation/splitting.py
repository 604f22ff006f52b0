"""Divide the episodes of a dataset into parts that are alike: as many successes, tags and operators in each."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset
from aerial_il.data.recording.reader import read_origin
from aerial_il.data.table import Row

log = logging.getLogger(__name__)
ALIKE = ("task", "success", "tag", "operator")  # what every part has its share of
ROUNDING = 1e-6


def read_shares(parts: Sequence[str]) -> dict[str, float]:
    """Return name -> share of ``train=0.8`` and the like, two or more that sum to 1.

    Raises:
        InvalidValueError: they are no parts.
    """
    shares = dict[str, float]()
    for part in parts:
        name, _, share = part.partition("=")
        try:
            shares[name] = float(share)
        except ValueError:
            raise InvalidValueError(f"parts: {part!r} is no NAME=SHARE, such as train=0.8.") from None
        if not name.isidentifier() or not shares[name] > 0:
            raise InvalidValueError(f"parts: {part!r} needs a plain name and a share above 0, such as train=0.8.")
    if len(shares) < 2 or len(shares) < len(parts) or abs(sum(shares.values()) - 1) > ROUNDING:
        raise InvalidValueError(
            f"parts=[{','.join(parts)}]: give two or more of different names whose shares sum to 1."
        )
    return shares


def families(dataset: Dataset) -> dict[str, str]:
    """Return uid -> the flight that an episode was generated from, of those that were; that flight is its own."""
    made = {uid: read_origin(file).get("made_of") for uid, file in dataset.files.items()}
    return {uid: str(of["source"]) for uid, of in made.items() if of}


def split(
    rows: Sequence[Row], shares: Mapping[str, float], seed: int, *, of: Mapping[str, str] | None = None
) -> dict[str, list[Row]]:
    """Return name -> rows of its part; the same for the same episodes, shares and seed, whatever their order.

    Episodes of one kind follow each other in random order, and each goes to the part that is furthest behind its share,
    or, of what was generated from one flight, where the first of them went.

    Args:
        rows: of the episodes. shares: of each part. seed: of the order. of: uid -> the flight that it was generated
            from.

    Raises:
        InvalidValueError: there are too few episodes for a part to get one.
    """
    rng = np.random.default_rng(seed)
    ordered = sorted(rows, key=lambda row: row["uid"])
    shuffled = [ordered[i] for i in rng.permutation(len(ordered))]
    shuffled.sort(key=lambda row: [str(row[name]) for name in ALIKE])
    parts, homes = {name: list[Row]() for name in shares}, dict[str, str]()
    first: dict[str, str] = {row["uid"]: (of or {}).get(row["uid"]) or row["uid"] for row in rows}
    if of and len({*first.values()}) < len(shares):
        log.warning("All was generated from too few flights to keep them apart: the parts share what they show.")
        first = {uid: uid for uid in first}
    for count, row in enumerate(shuffled, start=1):
        behind = max(shares, key=lambda name: shares[name] * count - len(parts[name]))
        parts[homes.setdefault(first[row["uid"]], behind)].append(row)
    if empty := [name for name, part in parts.items() if not part]:
        raise InvalidValueError(f"{len(rows)} episodes are too few: none is left for {', '.join(empty)}.")
    return {name: sorted(part, key=lambda row: row["uid"]) for name, part in parts.items()}

"""Judge demonstrations against each other: which stand still, jerk, hit bounds, come late, act unlike others, repeat.

Each measure becomes a column of the dataset, for info, filter and browse: idle, jerk, saturation, inconsistency, lag_s,
information, repeats (the name of the same one), and suspect (the reasons; empty for none).

With policy= and flown= each demonstration that a run learned from has its influence on the success of that policy's
own flights, too: below 0, they would go better without it.

Example: aerial-il judge datasets/pick
Example: aerial-il judge datasets/pick policy=runs/pick flown=datasets/flown
Example: aerial-il filter datasets/pick where="suspect == ''" out=datasets/sound
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aerial_il.cli.as_json import AsJson
from aerial_il.cli.tables import table
from aerial_il.workflows.judge import Judge, judge

if TYPE_CHECKING:
    from aerial_il.data.quality.judge import Judgement


@dataclass(frozen=True, kw_only=True)
class Judged(AsJson, Judge):
    """How it is shown."""


SETTINGS, BARE = Judged, ("dataset",)


def run(settings: Judged) -> None:
    """Print the suspects, and how many there are of each kind."""
    found = judge(settings)
    settings.show(dict(found.columns), lambda: "\n\n".join(_as_text(found, settings.dataset)))


def _as_text(found: Judgement, dataset: str) -> Iterator[str]:
    yield _suspects(found, dataset)
    if scores := found.columns.get("influence"):
        harm = sum(float(score) < 0.0 for score in scores.values())
        yield (
            f"{harm} of {len(scores)} demonstrations have a negative influence on the flights' success.\n"
            f'Next: aerial-il filter {dataset} where="influence > 0" out={dataset.rstrip("/")}-helpful'
        )


def _suspects(found: Judgement, dataset: str) -> str:
    suspects, count = found.suspects, len(found.columns["suspect"])
    if not suspects:
        return f"{count} demonstrations, none of them suspect."
    reasons = Counter(reason for why in suspects.values() for reason in why.split(", "))
    told = ", ".join(f"{reason} {times}" for reason, times in reasons.most_common())
    measures = [name for name in found.columns if name not in ("suspect", "repeats")]
    rows = [
        {"uid": uid, "suspect": why, **{name: found.columns[name].get(uid, "") for name in measures}}
        for uid, why in suspects.items()
    ]
    head = f"{len(suspects)} of {count} demonstrations are suspect: {told}."
    after = f"Look at one: aerial-il view {dataset} episode={next(iter(suspects))}"
    where = "suspect == ''" if found.kept else f"uid not in {[*suspects]}"
    then = f'Next: aerial-il filter {dataset} where="{where}" out={dataset.rstrip("/")}-sound'
    return "\n\n".join([head, table(rows), f"{after}\n{then}"])

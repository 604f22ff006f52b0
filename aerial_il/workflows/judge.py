"""Judge the demonstrations of a dataset, and keep what is found as columns of its table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from aerial_il.core.checks import require_choice
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading

if TYPE_CHECKING:
    from collections.abc import Mapping

    from aerial_il.data.quality.judge import Judgement

WEIGHTS = "policy_sha256"  # in the settings of a flight


@dataclass(frozen=True, kw_only=True)
class Judge(Reading):
    """What is judged.

    Attributes:
        dataset: whose successes are judged, against each other.
        policy: a run that was cloned from it; each of its demonstrations is then judged by its influence, too.
        flown: recordings of that policy's own flights, successes and failures, as aerial-il fly makes them.
        output: what of the policy's network is differentiated for that: the square of what it answers, which tells
            demonstrations apart by where they were flown; or, of flights with noise in their actions, their likelihood.
        keep: write what is found into the dataset, for info, filter and browse; others' data are left alone.
        progress: show a progress bar.
    """

    dataset: str
    policy: str | None = None
    flown: str | None = None
    output: Literal["square", "likelihood"] = "square"
    keep: bool = True
    progress: bool = True

    def __post_init__(self) -> None:
        require_choice(self, "output", Literal["square", "likelihood"])
        if (self.policy is None) != (self.flown is None):
            raise InvalidValueError(
                f"policy={self.policy} and flown={self.flown}: influence takes a run, and recordings of its own "
                "flights. Fly some: aerial-il fly policy=RUN episodes=100 out=datasets/flown"
            )


def judge(settings: Judge) -> Judgement:
    """Return what measures say of each success, and the influence of each demonstration that ``policy`` learned from.

    Raises:
        InvalidValueError: there are too few; or the policy was not cloned from them, or nobody can say what its flights
            owe to which. DemoError: the dataset, or the flights, cannot be read.
    """
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.folder import DatasetFolder
    from aerial_il.data.quality.judge import judge as judged
    from aerial_il.data.table import write_column

    dataset = open_dataset(settings.dataset, **settings.answers, states=False)
    if len(cells := sorted({f"{part.spec.robot} {part.spec.task}" for part in dataset.parts})) > 1:
        raise InvalidValueError(
            f"{settings.dataset} has flights of {', '.join(cells)}: judge each of its folders alone."
        )
    bar = Progress(dataset, desc="judge", unit="ep", total=len(dataset), disable=not settings.progress)
    influence = _influence(settings)
    found = judged(bar)
    found = replace(found, columns={**found.columns, **influence})
    if settings.keep and dataset.path.is_dir() and DatasetFolder(dataset.path).spec() is not None:
        for name, values in found.columns.items():
            write_column(dataset.path, name, values)
        return replace(found, kept=True)
    return found


def _influence(settings: Judge) -> dict[str, dict[str, float]]:
    """Return the column of each demonstration's influence on the success of the policy's own flights; none without."""
    if settings.policy is None or settings.flown is None:
        return {}
    from aerial_il.algorithms.supervised.influence import influence
    from aerial_il.data.dataset import open_dataset
    from aerial_il.evaluation.rollouts import known_by
    from aerial_il.evaluation.training_run import read_run
    from aerial_il.policies import load_policy
    from aerial_il.workflows.parts.learned_from import learned_from

    learned, policy = learned_from(read_run(settings.policy), settings.dataset), load_policy(settings.policy)
    flights = open_dataset(settings.flown, failures=True, states=False, cameras=policy.config.images)
    for flight in flights.one_of_each():
        require_own(flight.provenance, settings, known_by(policy))
    scores = influence(policy, [*learned.kept, *learned.held_out], flights, output=settings.output)
    return {"influence": {uid: round(score, 5) for uid, score in scores.items()}}


def require_own(origin: Mapping[str, Any], settings: Judge, known: Mapping[str, str]) -> None:
    """Refuse flights of another policy: by its weights, or where these were not recorded by its folder."""
    pilot, flown = str(origin.get("policy")), (origin.get("settings") or {}).get(WEIGHTS)
    alike = Path(pilot).resolve() == Path(str(settings.policy)).resolve()
    if not (alike if flown is None else flown == known[WEIGHTS]):
        who = f"{pilot} with other weights than it has now" if alike else f"{pilot}, not by {settings.policy}"
        raise InvalidValueError(
            f"{settings.flown} was flown by {who}: it does not tell what that learned from whom. Fly it: "
            f"aerial-il fly policy={settings.policy} episodes=100 out=datasets/flown"
        )

"""A dataset summed up in one pass: its table, what it covers, and what measures of quality say of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.progress import Progress
from aerial_il.data.coverage import Coverage
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.quality.judge import judge
from aerial_il.data.table import Row, columns_of, describe_episode

SUSPECT, UNLIKE = "suspect", "inconsistency"


@dataclass(frozen=True)
class Summary:
    """What there is to say of a dataset.

    Attributes:
        rows: of its table, with the columns of :mod:`.quality.judge` for the demonstrations that were judged.
        coverage: of states, actions and starts. left_out: episodes that could not be read.
        assumed: what is taken for granted of it, as no file says so.
        judged: where the verdicts are from, or why there are none, in a sentence.
    """

    rows: Sequence[Row]
    coverage: Coverage
    left_out: int
    judged: str
    assumed: Sequence[str] = ()

    @property
    def suspects(self) -> list[Row]:
        """Demonstrations that are suspect, those first that act least as others do."""
        return _least_alike(row for row in self.rows if row.get(SUSPECT))

    @property
    def outliers(self) -> list[Row]:
        """All demonstrations that were judged: suspects first, then those that act least as others do."""
        return [*self.suspects, *_least_alike(r for r in self.rows if r.get(SUSPECT) == "" and UNLIKE in r)]


def summarise(dataset: Dataset, *, progress: bool = False) -> Summary:
    """Read every episode once; demonstrations are judged unless ``aerial-il judge`` has done it.

    Args:
        dataset: opened with ``failures=True``, if its failures are to be counted. progress: show a progress bar.

    Raises:
        DemoError: no episode can be read.
    """
    columns, rows, covered = columns_of(dataset), list[Row](), list[Coverage]()

    def seen() -> Iterator[Episode]:
        for episode in Progress(dataset, desc="card", unit="ep", total=len(dataset), disable=not progress):
            covered[:] = covered or [Coverage.of(episode, len(dataset))]
            rows.append(describe_episode(episode))
            if covered[0].add(episode) and episode.success and not covered[0].sees_images_alone:
                yield episode

    found, judged = _verdicts(seen(), columns)
    if not covered:
        raise DemoError(dataset.path, "has no episode that can be read.")
    if covered[0].sees_images_alone:
        judged = "Pictures alone are not judged."
    if unjudged := sum(row["success"] and row["uid"] not in found.get(SUSPECT, {}) for row in rows) if found else 0:
        judged += f" {unjudged} demonstrations have no verdict: aerial-il judge gives them one."
    more = {**columns, **found}
    rows = [row | {name: more[name].get(row["uid"]) for name in more} for row in rows]
    return Summary(rows, covered[0], len(dataset) - len(rows), judged, dataset.survey.assumed)


def _verdicts(episodes: Iterator[Episode], columns: Mapping[str, Any]) -> tuple[Mapping[str, Mapping[str, Any]], str]:
    """Return the columns of a judgement and where it is from, having gone through all episodes."""
    if SUSPECT in columns:
        for _ in episodes:
            pass
        return columns, "As aerial-il judge has found and kept."
    try:
        return judge(episodes).columns, "Judged for this page, against each other."
    except InvalidValueError as error:
        return {}, str(error)


def _least_alike(rows: Iterator[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: -(row.get(UNLIKE) or 0.0))

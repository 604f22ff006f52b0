"""Make datasets of episodes of others: put several together, split one, or keep what a condition holds for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.reading import Reading
from aerial_il.workflows.parts.names import at_least

if TYPE_CHECKING:
    from aerial_il.data.dataset import Dataset


@dataclass(frozen=True, kw_only=True)
class Merge(Reading):
    """What is put together.

    Attributes:
        datasets: two or more, of one environment; their episodes stay where they are, too.
        out: folder of the new dataset.
        mix: put together what differs in tier, flight law, pilot, settings or engine.
        progress: show a progress bar.
    """

    datasets: tuple[str, ...]
    out: str
    mix: bool = False
    progress: bool = True

    def __post_init__(self) -> None:
        if len(self.datasets) < 2:
            raise InvalidValueError(f"datasets=[{','.join(self.datasets)}]: name two or more, datasets=[A,B].")


@dataclass(frozen=True, kw_only=True)
class Split(Reading):
    """What is split.

    Attributes:
        dataset: whose episodes are divided.
        parts: their names and shares, which sum to 1.
        out: folder in which each part gets its folder.
        seed: of the choice.
        progress: show a progress bar.
    """

    dataset: str
    parts: tuple[str, ...] = ("train=0.8", "validation=0.2")
    out: str
    seed: int = 0
    progress: bool = True

    def __post_init__(self) -> None:
        at_least(self, seed=0)


@dataclass(frozen=True, kw_only=True)
class Filter(Reading):
    """What is kept.

    Attributes:
        dataset: whose episodes are chosen from.
        where: condition on an episode's columns in aerial-il info, or on its provenance.
        out: folder of the new dataset.
        progress: show a progress bar.
    """

    dataset: str
    where: str
    out: str
    progress: bool = True


@dataclass(frozen=True, kw_only=True)
class Derived:
    """A dataset that was made: where it is, its number of episodes, and how many there were to choose from."""

    path: Path
    episodes: int
    of: int


def merge(settings: Merge) -> Derived:
    """Put datasets together, and return the new one.

    Raises:
        InvalidValueError: two of them are of different environments or made otherwise, or ``out`` is taken.
    """
    from aerial_il.data.curation.derived import check_out, derive
    from aerial_il.data.curation.merging import common_spec, joined

    check_out(settings.out, settings.datasets)
    datasets = [_open(path, settings) for path in settings.datasets]
    spec = common_spec(datasets, mix=settings.mix)
    chosen = joined(datasets, progress=settings.progress)
    path = derive(settings.out, spec, chosen, {"made_by": "aerial_il", "command": "merge"}, progress=settings.progress)
    return Derived(path=path, episodes=_count(path), of=sum(map(len, datasets)))


def split(settings: Split) -> list[Derived]:
    """Split a dataset, and return its parts, each a dataset.

    Raises:
        InvalidValueError: the shares are none, a part would be empty, or a place is taken.
    """
    from aerial_il.data.curation import splitting
    from aerial_il.data.curation.derived import Chosen, check_out, derive, recorded_spec
    from aerial_il.data.table import read_table

    shares = splitting.read_shares(settings.parts)
    check_out(settings.out, [settings.dataset], [*shares])
    dataset = _open(settings.dataset, settings)
    rows = read_table(dataset, progress=settings.progress)
    spec = recorded_spec(dataset, [row["uid"] for row in rows])
    made, parts = [], splitting.split(rows, shares, settings.seed, of=splitting.families(dataset))
    for name, chosen in parts.items():
        how = {"made_by": "aerial_il", "command": "split", "part": name, "parts": shares, "seed": settings.seed}
        path = derive(Path(settings.out) / name, spec, [Chosen(dataset, chosen)], how, progress=settings.progress)
        made.append(Derived(path=path, episodes=_count(path), of=len(rows)))
    return made


def filter(settings: Filter) -> Derived:
    """Make a dataset of the episodes for which the condition holds, and return it.

    Raises:
        InvalidValueError: it holds for none, or ``out`` is taken. UnknownNameError: there is no such column.
    """
    from aerial_il.data.curation.derived import Chosen, check_out, derive, recorded_spec
    from aerial_il.data.curation.selection import select

    check_out(settings.out, [settings.dataset])
    dataset = _open(settings.dataset, settings)
    chosen = Chosen(dataset, select(dataset, settings.where, progress=settings.progress))
    how = {"made_by": "aerial_il", "command": "filter", "where": settings.where}
    spec = recorded_spec(dataset, [row["uid"] for row in chosen.rows])
    path = derive(settings.out, spec, [chosen], how, progress=settings.progress)
    return Derived(path=path, episodes=_count(path), of=len(dataset))


def _count(path: Path) -> int:
    """Return how many episodes lie in a dataset's folder: one that was made before may have been edited since."""
    from aerial_il.data.folder import KINDS, DatasetFolder

    return sum(len(DatasetFolder(path).files(kind)) for kind in KINDS)


def _open(path: str, reading: Reading) -> Dataset:
    """Open all episodes of a dataset; with pictures and states where they will have to be recorded anew."""
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(path, **reading.answers, failures=True, states=False)
    return dataset if dataset.files else open_dataset(path, **reading.answers, failures=True, cameras=True)

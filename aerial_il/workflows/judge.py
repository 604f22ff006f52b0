"""Judge the demonstrations of a dataset, and keep what is found as columns of its table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from aerial_il.data.reading import Reading

if TYPE_CHECKING:
    from aerial_il.data.quality.judge import Judgement


@dataclass(frozen=True, kw_only=True)
class Judge(Reading):
    """What is judged.

    Attributes:
        dataset: whose successes are judged, against each other.
        keep: write what is found into the dataset, for info, filter and browse; others' data are left alone.
        progress: show a progress bar.
    """

    dataset: str
    keep: bool = True
    progress: bool = True


def judge(settings: Judge) -> Judgement:
    """Return what measures say of each success.

    Raises:
        InvalidValueError: there are too few. DemoError: the dataset cannot be read.
    """
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.folder import DatasetFolder
    from aerial_il.data.quality.judge import judge as judged
    from aerial_il.data.table import write_column

    dataset = open_dataset(settings.dataset, **settings.answers, states=False)
    bar = Progress(dataset, desc="judge", unit="ep", total=len(dataset), disable=not settings.progress)
    found = judged(bar)
    if settings.keep and dataset.path.is_dir() and DatasetFolder(dataset.path).spec() is not None:
        for name, values in found.columns.items():
            write_column(dataset.path, name, values)
        return replace(found, kept=True)
    return found

"""Which datasets can become one: those of one environment, and, unless they are to be mixed, made in one way."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sha256_of
from aerial_il.core.specs import EnvSpec
from aerial_il.data.curation.derived import Chosen, differences, recorded_spec
from aerial_il.data.dataset import Dataset
from aerial_il.data.mixture import check_alike
from aerial_il.data.table import Row, read_table


def common_spec(datasets: Sequence[Dataset], *, mix: bool) -> EnvSpec:
    """Return the specification of datasets that can be one.

    Args:
        datasets: at least one, the first of which the others are to join.
        mix: whether they may differ in tier, flight law, pilot, settings or engine.

    Raises:
        InvalidValueError: two differ; says in what.
    """
    first, (spec, *others) = datasets[0], [recorded_spec(dataset) for dataset in datasets]
    for other, its_spec in zip(datasets[1:], others, strict=True):
        if differing := differences(spec, its_spec):
            raise InvalidValueError(
                f"{first.path} and {other.path} are of different environments and cannot be one dataset: "
                f"{'; '.join(differing[:3])}. Training takes a folder that holds both as they are."
            )
        if not mix:
            check_alike(first, other)
    return _united([spec, *others])


def joined(datasets: Sequence[Dataset], *, progress: bool) -> list[Chosen]:
    """Return all episodes of all datasets, of those that several hold one.

    Raises:
        InvalidValueError: two are different and have one name.
    """
    held, chosen = dict[str, Path](), list[Chosen]()
    for number, dataset in enumerate(datasets):
        rows = list[Row]()
        for row in read_table(dataset, progress=progress):
            uid = row["uid"]
            file, other = dataset.files.get(uid), held.get(uid)
            if file is not None and other is not None:
                _require_same(uid, other, file)
                continue
            held |= {} if file is None else {uid: file}
            rows.append(row)
        chosen.append(Chosen(dataset, rows, prefix=f"{number}-{dataset.path.stem}-"))
    return chosen


def _require_same(uid: str, one: Path, other: Path) -> None:
    if not one.samefile(other) and sha256_of(one) != sha256_of(other):
        raise InvalidValueError(
            f"{one} and {other} are different episodes of one name, as if one of them was relabelled. Leave one out "
            f"first: aerial-il filter where=\"uid != '{uid}'\""
        )


def _united(specs: Sequence[EnvSpec]) -> EnvSpec:
    """Return the first specification, its bounds widened to those of all where they were read off the data."""
    first = specs[0]
    if not first.is_foreign:
        return first
    low, high = np.min([s.action.low for s in specs], 0), np.max([s.action.high for s in specs], 0)
    return replace(first, action=replace(first.action, low=low, high=high), max_steps=max(s.max_steps for s in specs))

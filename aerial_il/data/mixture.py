"""Keep a dataset of one kind: the same tier, flight law, pilot and settings, unless somebody wants them mixed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from aerial_il.core.composition import dotted
from aerial_il.core.errors import InvalidValueError, shortened
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import KINDS, DatasetFolder
from aerial_il.data.provenance import conditions_of, made_by
from aerial_il.data.recording.reader import read_origin


def check_unmixed(folder: DatasetFolder, uid: str, provenance: Mapping[str, Any]) -> None:
    """Refuse to add flights to a dataset whose flights were made otherwise.

    Args:
        folder: the dataset; a new one takes anything.
        uid: name of any flight to be added, which ends in a digest of how it is made.
        provenance: where it comes from.

    Raises:
        InvalidValueError: no flight there was made like it; names what differs.
    """
    there = _one_of_each(folder)
    if there and made_by(uid) not in there:
        known = [read_origin(file) for file in there.values()]
        _refuse(folder.path, known, provenance, "Choose another folder with out=PATH, or set")


def check_alike(dataset: Dataset, other: Dataset) -> None:
    """Refuse to put two datasets together of which the second has flights made as none of the first.

    Raises:
        InvalidValueError: names what differs.
    """
    there = {made_by(episode.uid): episode.provenance for episode in dataset.one_of_each()}
    for episode in other.one_of_each():
        if made_by(episode.uid) not in there:
            _refuse(dataset.path, [*there.values()], episode.provenance, "Set")


def _refuse(path: Path, there: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any], advice: str) -> NoReturn:
    mine = conditions_of(provenance)
    nearest = min((_differences(conditions_of(each), mine) for each in there), key=len)
    raise InvalidValueError(
        f"{path} holds flights made with other settings: "
        f"{'; '.join(nearest or ['the specification of the environment'])} (existing != requested). "
        f"{advice} mix=true to keep both in one."
    )


def _one_of_each(folder: DatasetFolder) -> dict[str, Path]:
    """Return digest -> a recording, for every way in which the flights of a dataset were made."""
    return {made_by(file.stem): file for kind in KINDS for file in folder.files(kind) if made_by(file.stem)}


def _differences(there: Mapping[str, Any], mine: Mapping[str, Any]) -> list[str]:
    """Return each key that differs, of nested mappings the innermost alone, with both values."""
    one, other = ({key: leaf for key, leaf in dotted(each).items() if leaf != {}} for each in (there, mine))
    keys = (key for key in dict.fromkeys((*one, *other)) if one.get(key) != other.get(key))
    return [f"{key} {shortened(str(one.get(key)))} != {shortened(str(other.get(key)))}" for key in keys]

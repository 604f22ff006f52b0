"""Make a dataset of episodes of others: the same files where the disk allows, copies elsewhere.

It is put together in ``.part/`` and gets its index and folders at the end, so that a killed process leaves nothing that
looks like a dataset; ``lineage.json`` says what it was made of and how.
"""

import hashlib
import logging
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os.path import realpath
from pathlib import Path
from typing import Any

from aerial_il.core.bounded import read_json
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sha256_of, sync_folder, write_json
from aerial_il.core.places import claim_folder
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.core.specs import CONDITIONS, EnvSpec
from aerial_il.data.columns import COLUMNS
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import DEMOS, FAILURES, INDEX, KINDS, LINEAGE, DatasetFolder, link
from aerial_il.data.recording.writer import storing, write_episode
from aerial_il.data.table import Row, columns_of, remember, write_column

log = logging.getLogger(__name__)
PART = ".part"
SEEN = ("action.low", "action.high", "max_steps")  # of a specification that was read off the data: it grows with them
Place = str | os.PathLike[str]


@dataclass(frozen=True)
class Chosen:
    """Episodes of a dataset that was opened with its failures, and with pictures and states where it has no files.

    Attributes:
        dataset: where they are. rows: theirs in its table. prefix: before the new names of those that have no files.
    """

    dataset: Dataset
    rows: Sequence[Row]
    prefix: str = ""

    def name(self, uid: str) -> str:
        """Return the name of an episode in the new dataset."""
        return uid if uid in self.dataset.files else f"{self.prefix}{uid}"


def recorded_spec(dataset: Dataset, uids: Sequence[str] = ()) -> EnvSpec:
    """Return the specification of episodes as recordings: some formats keep no states of the simulator.

    Args:
        dataset: where they are. uids: which ones; empty for all.

    Raises:
        InvalidValueError: they are of different environments, as those of several folders may be.
    """
    if not dataset.files:
        return replace(dataset.spec, state_size=dataset[0].states.shape[1])
    folders = dict[Path, list[str]]()
    for uid in uids or dataset.uids:
        folders.setdefault(dataset.files[uid].parent.parent, []).append(uid)
    (first, spec), *others = ((folder, dataset.only(each).spec) for folder, each in folders.items())
    for folder, other in others:
        if differing := differences(spec, other):
            raise InvalidValueError(
                f"{first} and {folder} are of different environments and cannot be one dataset: "
                f"{'; '.join(differing[:3])}. Training takes a folder that holds both as they are."
            )
    return spec


def differences(mine: EnvSpec, theirs: EnvSpec) -> list[str]:
    """Return in what two environments differ whose episodes are to be one dataset."""
    ignored = SEEN if mine.is_foreign and theirs.is_foreign else ()
    return [each for each in mine.differences(theirs, ignore=CONDITIONS) if not each.startswith(ignored)]


def check_out(out: Place, sources: Sequence[Place], parts: Sequence[str] = ()) -> None:
    """Refuse a place that is one of the sources or holds what is somebody else's; ``parts`` are folders in it."""
    if parts:
        claim_folder(out, tuple(f"{part}/{LINEAGE}" for part in parts))
    for part in parts:
        check_out(Path(out) / part, sources)
    if clashing := next((source for source in sources if realpath(source) == realpath(out)), None):
        raise InvalidValueError(f"out={out} is where the episodes of {clashing} are: name another folder.")
    if not parts:
        DatasetFolder(out).require_own()


def derive(
    out: Place,
    spec: EnvSpec,
    chosen: Sequence[Chosen],
    made: Mapping[str, Any],
    *,
    progress: bool = False,
) -> Path:
    """Make a dataset of the chosen episodes; one that was made so already is left as it is.

    Args:
        out: its folder. spec: of its environment. chosen: what goes into it; all names are different.
        made: how, in plain values: the command, and its keys. progress: show a progress bar.

    Raises:
        InvalidValueError: the folder holds another dataset or somebody else's files, or another process writes there.
        StorageError: it cannot be written; the same call again starts over.
    """
    folder = DatasetFolder(out)
    folder.require_own()
    lineage = _lineage(chosen, made)
    with storing(folder.path):
        folder.path.mkdir(parents=True, exist_ok=True)
    with folder.alone():
        _derive(folder, spec, chosen, lineage, progress=progress)
    return folder.path


def _derive(
    folder: DatasetFolder, spec: EnvSpec, chosen: Sequence[Chosen], lineage: dict[str, Any], *, progress: bool
) -> None:
    held = folder.spec() is not None or any(folder.files(kind) for kind in KINDS)
    if held and _told(folder.path) != lineage:
        raise InvalidValueError(f"out={folder.path} holds a dataset already. Name a new folder with out=PATH.")
    wanted, lies = sum(len(each.rows) for each in chosen), sum(len(folder.files(kind)) for kind in KINDS)
    if folder.spec() is not None and not (folder.path / PART).exists() and lies != wanted:
        log.warning(
            "%s was made before, and has been edited since: it holds %d of %d episodes.", folder.path, lies, wanted
        )
    if folder.spec() is None or (folder.path / PART).exists():
        _build(folder, spec, chosen, lineage, progress=progress)


def lineage_of(path: Path) -> dict[str, Any] | None:
    """Return what a dataset was made of and how, or None for one that was recorded."""
    try:
        return dict(read_json(path / LINEAGE))
    except (OSError, ValueError, TypeError):
        return None


def _build(
    folder: DatasetFolder, spec: EnvSpec, chosen: Sequence[Chosen], lineage: dict[str, Any], *, progress: bool
) -> None:
    part = DatasetFolder(folder.path / PART)
    if part.path.is_symlink() or (part.path.exists() and not (folder.path / LINEAGE).exists()):
        raise InvalidValueError(f"{part.path} was not written by aerial_il: choose another folder with out=PATH.")
    if folder.spec() is None:
        with storing(folder.path / LINEAGE):
            write_json(folder.path / LINEAGE, lineage | {"provenance": provenance()})
        shutil.rmtree(part.path, ignore_errors=True)
        digests = dict[str, str]()
        count = sum(len(each.rows) for each in chosen)
        with Progress(total=count, desc=str(lineage["command"]), unit="ep", disable=not progress) as bar:
            for each in chosen:
                known = _digests(each.dataset)
                for uid in (row["uid"] for row in each.rows):
                    _put(part, spec, each, uid)
                    if uid in known:
                        digests[uid] = known[uid]
                    bar.update()
        part.write_index(spec, digests)
        _write_columns(folder, chosen)
        with storing(folder.path / INDEX):
            os.replace(part.path / INDEX, folder.path / INDEX)
    with storing(folder.path):
        for kind in KINDS:
            if (part.path / kind).exists():
                os.replace(part.path / kind, folder.path / kind)
        sync_folder(folder.path)
        shutil.rmtree(part.path, ignore_errors=True)
    rows = ({name: row[name] for name in COLUMNS} for each in chosen for row in each.rows)
    found = ((folder.find(row["uid"]), row) for row in rows)
    remember(folder.path, ((file, row) for file, row in found if file is not None))


def _put(part: DatasetFolder, spec: EnvSpec, chosen: Chosen, uid: str) -> None:
    """Put one episode into a folder: its file, or where it has none, a new recording of it."""
    source, name = chosen.dataset.files.get(uid), chosen.name(uid)
    if source is None:
        episode = chosen.dataset[uid]
        origin = {**episode.provenance, "source": {"dataset": str(chosen.dataset.path), "uid": uid}}
        again = replace(episode, uid=name, spec=spec, provenance=origin)
        write_episode(again, part.file(name, DEMOS if episode.success else FAILURES))
        return
    lies = source.parent.name
    target = part.file(name, lies if lies in KINDS else DEMOS if chosen.dataset[uid].success else FAILURES)
    with storing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        link(source, target)


def _digests(dataset: Dataset) -> dict[str, str]:
    """Return uid -> SHA-256 of the recordings that the index of their folder lists."""
    folders = {file.parent.parent for file in dataset.files.values()}
    indices = {folder: DatasetFolder(folder).read_index() for folder in folders}
    listed = {
        uid: indices[file.parent.parent].get(file.parent.name, {}).get(file.stem) for uid, file in dataset.files.items()
    }
    return {uid: digest for uid, digest in listed.items() if digest}


def _write_columns(folder: DatasetFolder, chosen: Sequence[Chosen]) -> None:
    """Give the new dataset what the further columns of its sources say of its episodes; of two values the first."""
    kept, columns = [each.name(row["uid"]) for each in chosen for row in each.rows], dict[str, dict[str, Any]]()
    for each in chosen:
        for name, values in columns_of(each.dataset).items():
            said = {each.name(uid): value for uid, value in values.items()}
            columns[name] = {uid: said[uid] for uid in kept if said.get(uid) is not None} | columns.get(name, {})
    for name, values in columns.items():
        with storing(folder.path / name):
            write_column(folder.path, name, values)


def _lineage(chosen: Sequence[Chosen], made: Mapping[str, Any]) -> dict[str, Any]:
    sources = [
        {
            "path": str(each.dataset.path),
            "episodes": len(each.rows),
            "sha256": _identity(each),
            "lineage": lineage_of(each.dataset.path),
        }
        for each in chosen
    ]
    return {"schema": 1, **made, "sources": sources}


def _identity(chosen: Chosen) -> str:
    """Return what tells the chosen episodes from others: a digest of their names and of those of their files."""
    known, uids = _digests(chosen.dataset), sorted(row["uid"] for row in chosen.rows)
    lines = [f"{uid} {known.get(uid, '')}" for uid in uids]
    if not known.keys() >= {*uids}:
        lines += _files_of(chosen.dataset.path)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _files_of(path: Path) -> Iterator[str]:
    """Yield a line for each file of others' data: its name, size and digest."""
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            yield f"{file.relative_to(path)} {file.stat().st_size} {sha256_of(file)}"


def _told(path: Path) -> dict[str, Any] | None:
    told = lineage_of(path)
    return None if told is None else {key: value for key, value in told.items() if key != "provenance"}

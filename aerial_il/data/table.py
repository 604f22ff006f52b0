"""The table of a dataset: one row an episode, which a recording that has not changed need not be read for again.

Further columns, such as scores, lie in ``columns/NAME.json`` of a folder of recordings: uid -> a plain value.
"""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from aerial_il.core.bounded import read_json
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.core.progress import Progress
from aerial_il.core.specs import EnvSpec
from aerial_il.data.columns import COLUMNS
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.data.provenance import DROPPED, engine_of, instruction_of, operator_of

CACHE = Path("cache", "info.json")  # below a folder of recordings
FURTHER = "columns"
TAG = "tag"  # in the provenance of an episode that was given one

Row = dict[str, Any]


def read_table(dataset: Dataset, *, progress: bool = False) -> list[Row]:
    """Return a row for each episode that can be read, in the order of the dataset.

    Args:
        dataset: opened with ``failures=True``, if its failures are to be seen.
        progress: show a progress bar while episodes are read.
    """
    cache, known = dataset.path / CACHE, _known(dataset.path / CACHE)
    stamps = {uid: stamp(file) for uid, file in dataset.files.items()}
    rows = {uid: row for uid, (when, row) in known.items() if stamps.get(uid) == when and row.keys() == {*COLUMNS}}
    if unknown := [uid for uid in dataset.uids if uid not in rows]:
        read = Progress(dataset.only(unknown), desc="read", unit="ep", total=len(unknown), disable=not progress)
        rows |= {episode.uid: describe_episode(episode) for episode in read}
        if stamps and dataset.path.is_dir():
            _write(cache, known, {uid: (when, rows[uid]) for uid, when in stamps.items() if uid in rows})
    further = columns_of(dataset)
    return [
        rows[uid] | {name: column.get(uid) for name, column in further.items()} for uid in dataset.uids if uid in rows
    ]


def columns_of(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return name -> uid -> value of the further columns of a dataset: those of the folders that its recordings lie in.

    Raises:
        DemoError: as :func:`read_columns`.
    """
    found = {name: dict(values) for name, values in read_columns(dataset.path).items()}
    told = {folder: read_columns(folder) for folder in {each.parent.parent for each in dataset.files.values()}}
    for name in sorted({name for columns in told.values() for name in columns}):
        column = found.setdefault(name, {})
        for uid, file in dataset.files.items():
            values = told[file.parent.parent].get(name, {})
            if file.stem in values:
                column[uid] = values[file.stem]
    return found


def read_columns(folder: Path) -> dict[str, dict[str, Any]]:
    """Return name -> uid -> value of the further columns of a folder.

    Raises:
        DemoError: one cannot be read, or has the name of a column that every table has.
    """
    found = dict[str, dict[str, Any]]()
    for file in sorted((folder / FURTHER).glob("*.json")):
        try:
            values = read_json(file)
        except (OSError, ValueError) as error:
            raise DemoError(file, f"cannot be read ({error}).") from error
        if not isinstance(values, dict) or not file.stem.isidentifier() or file.stem in COLUMNS:
            raise DemoError(file, "is no column: its name must be a new one, and it must map uids to values.")
        found[file.stem] = values
    return found


def write_column(folder: Path, name: str, values: Mapping[str, Any]) -> Path:
    """Give the table of a folder of recordings a further column.

    Args:
        name: a new one, as it is typed in ``where=``. values: uid -> number, text, truth value or None.

    Raises:
        InvalidValueError: the name is taken or none, or columns lie elsewhere, behind a link.
    """
    if (folder / FURTHER).is_symlink():
        raise InvalidValueError(f"{folder / FURTHER} is a link; nothing is written through it.")
    if not name.isidentifier() or name in COLUMNS:
        raise InvalidValueError(f"A column cannot be called {name!r}: it must be a name that no other has.")
    return write_json(folder / FURTHER / f"{name}.json", dict(values))


def remember(folder: Path, rows: Iterable[tuple[Path, Row]]) -> None:
    """Keep the rows of recordings that were just written, so that these need not be read for them.

    Args:
        folder: of the dataset. rows: each file and its row.
    """
    known = _known(folder / CACHE)
    _write(folder / CACHE, known, known | {row["uid"]: (stamp(file), row) for file, row in rows})


def describe_episode(episode: Episode) -> Row:
    """Return the row of an episode that was read."""
    phase = int(episode.phase[-1]) if len(episode) else -1
    phases = list(episode.provenance.get("phases", ()))
    return describe(
        episode.uid,
        episode.spec,
        episode.provenance,
        steps=len(episode),
        failure=failure_of(
            success=episode.success,
            dropped=episode.provenance.get("note") == DROPPED,
            crash=bool(episode.terminated[-1]),
            timeout=bool(episode.truncated[-1]),
        ),
        phase=phases[phase] if 0 <= phase < len(phases) else "",
        total_reward=episode.total_reward,
    )


def describe(
    uid: str,
    spec: EnvSpec,
    origin: Mapping[str, Any],
    *,
    steps: int,
    failure: str,
    phase: str,
    total_reward: float,
) -> Row:
    """Return the row of an episode.

    Args:
        uid: its name. spec: its environment. origin: its provenance. steps: how many it has.
        failure: see :func:`failure_of`. phase: name of the expert's phase in which it ended. total_reward: its return.
    """
    return {
        "uid": uid,
        "task": spec.task,
        "tier": origin.get("tier", spec.tier),
        "controller": origin.get("controller", spec.controller),
        "policy": str(origin.get("policy", "unknown")),
        "settings": " ".join(f"{key}={value}" for key, value in sorted(dict(origin.get("settings", {})).items())),
        "engine": None if spec.is_outside else engine_of(origin),
        "operator": operator_of(origin),
        "instruction": instruction_of(origin, spec),
        "tag": str(origin.get(TAG, "")),
        "seed": origin.get("seed"),
        "steps": steps,
        "seconds": round(steps * spec.control_dt_s, 2),
        "success": not failure,
        "failure": failure,
        "phase": phase,
        "return": round(total_reward, 2),
    }


def failure_of(*, success: bool, dropped: bool, crash: bool, timeout: bool) -> str:
    """Return why an episode failed: ``dropped``, ``crash``, ``timeout`` or ``other``; nothing for a success."""
    why = {"": success, "dropped": dropped, "crash": crash, "timeout": timeout, "other": True}
    return next(name for name, holds in why.items() if holds)


def stamp(file: Path) -> list[int]:
    """Return what changes with a file: its size and the time of its last change."""
    found = file.stat()
    return [found.st_size, found.st_mtime_ns]


def _write(cache: Path, known: Mapping[str, Any], rows: Mapping[str, Any]) -> None:
    """Write what was said of each file beside its stamp, over what is known of them, if the place is ours."""
    if (known or not cache.exists()) and not cache.parent.is_symlink():
        with suppress(OSError):  # somebody else's folder
            cache.parent.mkdir(exist_ok=True)
            write_json(cache, rows)


def _known(cache: Path) -> dict[str, Any]:
    """Return uid -> stamp of the file and what was said of it; nothing where the file is missing or none of ours."""
    try:
        found = read_json(cache)
        return {uid: (when, row) for uid, (when, row) in found.items() if row["uid"] == uid}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}

"""Read LeRobot v3 datasets, ours or foreign ones, straight from their files: nothing is opened that is not complete."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, STATE
from aerial_il.core.specs import UNKNOWN, EnvSpec, Field, Group
from aerial_il.data.formats.parts.lerobot.files import (
    REBUILD,
    check_lerobot,
    parquets,
    provenance,
    read_rows,
    read_table,
)
from aerial_il.data.formats.parts.lerobot.identity import UID, declared_spec, distinct
from aerial_il.data.formats.parts.lerobot.states import PROVENANCE
from aerial_il.data.formats.parts.lerobot.videos import camera_fields, clip_of, field_name, read_clip, read_stills
from aerial_il.data.provenance import INSTRUCTION
from aerial_il.data.source import Later, Raw, Rows, Source

SERIES = {  # column -> what it is
    "next.reward": "rewards", "next.success": "success", "next.done": "done", "next.terminated": "terminated",
    "next.truncated": "truncated", "frame_index": "frames", "timestamp": "times",
}  # fmt: skip
NUMBERS = ("float", "int", "uint", "bool")
MAX_EPISODES = 100_000
FAULTS = (LookupError, ArithmeticError, ValueError, TypeError, AttributeError, MemoryError, OSError, pa.ArrowException)
GROUPS: dict[str, Group] = {STATE: "proprio", ENVIRONMENT: "task"}


def read(path: Path) -> Source:
    """Return the demonstrations of a dataset.

    What LeRobot does not hold is left empty: simulator states, controls and the scene.

    Raises:
        DemoError: it is damaged or of another version.
    """
    with _typed(path):
        return _source(path, check_lerobot(path))


@contextmanager
def _typed(path: Path) -> Iterator[None]:
    """Say of which dataset it was that something in it could not be read."""
    try:
        yield
    except AerialError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"is malformed ({error!r}).", hint=REBUILD) from error


def _source(path: Path, info: Mapping[str, Any]) -> Source:
    features, told, ours = info["features"], _told(path), provenance(path)
    spec = _recorded_spec(path, ours) or declared_spec(features)
    vectors: dict[str, Group] = (
        GROUPS if spec else {name: GROUPS.get(name, "proprio") for name in features if _is_vector(name, features)}
    )
    if ACTION not in features or (spec is None and STATE not in features):
        raise DemoError(path, f"lacks action or {STATE}; nothing can be learnt from it here.", got=sorted(features))
    shapes = {name: tuple(map(int, features[name]["shape"])) for name in (*vectors, ACTION) if name in features}
    columns = [name for name in (*vectors, *SERIES, "episode_index", ACTION, UID) if name in features]
    table = _by_episode(read_rows(path, columns))
    index = table["episode_index"].to_numpy()
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    origins = {entry["uid"]: entry for entry in ours["episodes"]}
    several = len(_texts(told)) > 1
    raw, filters, splits = dict[str, Callable[[], Raw]](), dict[str, list[str]](), _splits(info)
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(index)], strict=True):
        rows, number = table.slice(start, end - start), int(index[start])
        uid = rows[UID][0].as_py() if UID in columns else f"episode_{number:06d}"
        row = _row(told, number)
        origin, uid = origins.get(uid) or _of_its_own(row, several=several), distinct(raw, uid)
        pictures = {f.name: _pictures(path, info, row, number, rows, f) for f in camera_fields(features)}
        raw[uid] = partial(_raw, path, rows, spec, origin, pictures, shapes, row.get("length"))
        for name in (name for name, part in splits.items() if number in part):
            filters.setdefault(name, []).append(uid)
    return Source(
        path=path,
        kind="a LeRobot dataset",
        raw=raw,
        spec=spec,
        control_dt_s=1 / info["fps"],
        robot=str(info.get("robot_type") or UNKNOWN),
        instruction=_instruction(told),
        labels={name: found for name in (*vectors, ACTION) if (found := _labels(features.get(name, {})))},
        groups=vectors,
        filters=filters if len(splits) > 1 else {},
        unread=() if UID in columns else tuple(_left(info)),
    )


def _is_vector(name: str, features: Mapping[str, Any]) -> bool:
    return name.startswith("observation.") and str(features[name].get("dtype")).startswith(NUMBERS)


def _by_episode(table: pa.Table) -> pa.Table:
    """Return rows with those of an episode one after the other, in the order that they have in the files."""
    index = table["episode_index"].to_numpy()
    return table if (np.diff(index) >= 0).all() else table.take(pa.array(np.argsort(index, kind="stable")))


def _splits(info: Mapping[str, Any]) -> dict[str, range]:
    """Return the parts that a dataset names, ``train: 0:40``, as ranges of episodes."""
    return {name: range(*map(int, str(part).split(":"))) for name, part in (info.get("splits") or {}).items()}


def _pictures(
    path: Path, info: Mapping[str, Any], row: Mapping[str, Any], number: int, rows: pa.Table, field: Field
) -> Later:
    """Return the pictures of an episode and a camera, which are decoded when they are used."""
    (key,) = (key for key in info["features"] if field_name(key) == field.name)

    def load(chosen: slice) -> np.ndarray:
        with _typed(path):
            if info["features"][key]["dtype"] == "image":
                return read_stills(path, parquets(path, "data"), key, number, field.shape)[chosen]
            times = (
                rows["timestamp"].to_numpy() if "timestamp" in rows.column_names else np.arange(len(rows)) / info["fps"]
            )
            return read_clip(clip_of(path, info, row, key, field, times[chosen].astype(float)))

    return Later((len(rows), *field.shape), np.dtype(np.uint8), load)


def _told(path: Path) -> pa.Table:
    """Return what ``meta/episodes`` says of each episode: length, task texts and places in videos; no statistics."""
    tables = []
    for file in parquets(path, "meta/episodes"):
        kept = ("episode_index", "length", "tasks")
        tables.append(read_table(file, [n for n in pq.read_schema(file).names if n in kept or n.startswith("videos/")]))
    if sum(map(len, tables)) > MAX_EPISODES:
        got = sum(map(len, tables))
        raise DemoError(path, "has absurdly many episodes.", expected=f"at most {MAX_EPISODES}", got=got)
    return pa.concat_tables(tables, promote_options="default") if tables else pa.table({})


def _row(told: pa.Table, episode: int) -> dict[str, Any]:
    """Return the metadata of an episode, which the table may hold in any order; empty if nothing."""
    found = np.flatnonzero(told["episode_index"].to_numpy() == episode)
    return told.slice(int(found[0]), 1).to_pylist()[0] if len(found) else {}


def _instruction(told: pa.Table) -> str:
    """Return the task text that all episodes share, empty where they differ."""
    texts = _texts(told)
    return str(texts.pop()) if len(texts) == 1 else ""


def _of_its_own(row: Mapping[str, Any], *, several: bool) -> dict[str, Any]:
    """Return what is known of a foreign episode alone: its task text, where a dataset has several."""
    text = " ".join(map(str, row.get("tasks") or ())) if several else ""
    return {"provenance": {"policy": UNKNOWN, INSTRUCTION: text}} if text else {}


def _texts(told: pa.Table) -> set[Any]:
    """Return the different task texts of the episodes."""
    if "tasks" not in told.column_names:
        return set()
    return {text for chunk in told["tasks"].chunks for text in chunk.flatten().unique().to_pylist()}


def _left(info: Mapping[str, Any]) -> Iterator[str]:
    """Yield what a foreign dataset holds and is not read: depth, and texts."""
    read = {field.name for field in camera_fields(info["features"])}
    for name, feature in sorted(info["features"].items()):
        if name.startswith("observation.") and not _is_vector(name, info["features"]) and field_name(name) not in read:
            yield f"{name} ({feature.get('dtype')})"


def _labels(feature: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a vector's elements, in a list or by kind as ``{"motors": [...]}``; none if not given."""
    names, shape = feature.get("names"), tuple(feature.get("shape", ()))
    names = next(iter(names.values()), None) if isinstance(names, dict) and len(names) == 1 else names
    labels = tuple(map(str, names)) if isinstance(names, list) else ()
    return labels if shape == (len(labels),) and len({*labels}) == len(labels) else ()


def _raw(
    path: Path,
    rows: pa.Table,
    spec: EnvSpec | None,
    origin: Mapping[str, Any],
    pictures: Mapping[str, Later],
    shapes: Mapping[str, tuple[int, ...]],
    length: int | None,
) -> Raw:
    with _typed(path):
        obs: dict[str, Rows] = {
            name: clip for name, clip in pictures.items() if spec is None or name in spec.observation.names
        }
        numbers = {name: _vectors(path, rows, name, shape) for name, shape in shapes.items()}
        actions = numbers.pop(ACTION)
        obs |= numbers if spec is None else _fields(spec, numbers)
        held = {name: rows[column].to_numpy() for column, name in SERIES.items() if column in rows.column_names}
        success, done = held.pop("success", None), held.pop("done", None)  # of ours, done is the last row and no more
        return Raw(
            obs=obs,
            actions=actions,
            success=origin.get("success", True if spec else None) if success is None else bool(success[-1]),
            done=done if spec is None else None,
            steps=length,
            provenance=origin.get("provenance", {"policy": UNKNOWN}),
            **held,
        )


def _fields(spec: EnvSpec, vectors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the fields of a specification that its vectors hold one after the other."""
    obs = {}
    for column, group in GROUPS.items():
        fields, end = spec.observation.of_group(group), 0
        for field in fields:
            start, end = end, end + field.size
            obs[field.name] = vectors[column][:, start:end].reshape(-1, *field.shape)
    return obs


def _vectors(path: Path, rows: pa.Table, column: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return a column of vectors as (T, *shape) float64, exact."""
    flat, widths = rows[column].combine_chunks(), {math.prod(shape)}
    while pa.types.is_nested(flat.type):
        widths = {*flat.value_lengths().to_pylist()} if pa.types.is_list(flat.type) and len(shape) == 1 else widths
        flat = flat.flatten()
    values = np.asarray(flat, float)
    if widths != {math.prod(shape)} or values.size != len(rows) * math.prod(shape):
        raise DemoError(path, "has a column of another width.", field=column, expected=math.prod(shape), got=widths)
    return values.reshape(len(rows), *shape)


def _recorded_spec(path: Path, provenance: Mapping[str, Any]) -> EnvSpec | None:
    try:
        return EnvSpec.from_dict(provenance["spec"]) if "spec" in provenance else None
    except AerialError as error:
        raise DemoError(path / PROVENANCE, f"has a malformed specification ({error}).") from error

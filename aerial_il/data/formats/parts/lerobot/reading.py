"""Read LeRobot v3 datasets, ours or foreign ones, straight from their files: nothing is opened that is not complete.

lerobot answers an incomplete dataset by asking the network for it, so completeness is checked here first.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from aerial_il.core.bounded import read_json
from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.files import sha256_of
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, STATE
from aerial_il.core.specs import UNKNOWN, EnvSpec, Field, Group
from aerial_il.data.formats.parts.content_digest import sealed
from aerial_il.data.formats.parts.lerobot.identity import UID, declared_spec, distinct
from aerial_il.data.formats.parts.lerobot.states import PROVENANCE
from aerial_il.data.formats.parts.lerobot.videos import camera_fields, clip_of, field_name, read_clip, read_stills
from aerial_il.data.source import Later, Raw, Rows, Source

REBUILD = "Derive it anew from the recordings with: aerial-il convert"
SUPPORTED = "v3."
SERIES = {  # column -> what it is
    "next.reward": "rewards", "next.success": "success", "next.done": "done", "next.terminated": "terminated",
    "next.truncated": "truncated", "frame_index": "frames", "timestamp": "times",
}  # fmt: skip
NUMBERS = ("float", "int", "uint", "bool")
MAX_TABLE_BYTES = 160 << 20
MAX_EPISODES = 100_000
TEXTS = "tasks.list.element"  # of episodes; a text that repeats is kept once, as a demo.uid is
MAX_SWELLING = 8  # times the bytes of a file that its columns may take
FAULTS = (LookupError, ArithmeticError, ValueError, TypeError, AttributeError, MemoryError, OSError, pa.ArrowException)
GROUPS: dict[str, Group] = {STATE: "proprio", ENVIRONMENT: "task"}


def check_lerobot(path: Path | str) -> dict[str, Any]:
    """Require that all files of a LeRobot v3 dataset are there and whole; return its ``info.json``.

    Raises:
        DemoError: names the file that is missing, cut, inconsistent or outside the folder.
    """
    path = Path(path)
    info = _read_json(path / "meta" / "info.json")
    try:
        _check_info(path, info)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise DemoError(path / "meta" / "info.json", f"is malformed ({error!r}).") from error
    rows, episodes = _count_rows(path, "data"), _count_rows(path, "meta/episodes")
    for what, expected, got in (("frames", info["total_frames"], rows), ("episodes", info["total_episodes"], episodes)):
        if expected != got:
            raise DemoError(path, f"is incomplete: its {what} do not add up.", expected=expected, got=got, hint=REBUILD)
    _check_files(path, _provenance(path))
    return info


def altered_files(path: Path) -> list[Path]:
    """Return the files of a dataset whose SHA-256 differs from what was written, videos included."""
    listed = {path / _inside(path, name): entry["sha256"] for name, entry in _provenance(path)["files"].items()}
    return [file for file, digest in listed.items() if sha256_of(file) != digest]


def _check_files(path: Path, provenance: Mapping[str, Any]) -> None:
    """Require that the files are those that were written; videos, which are not read here, by their sizes."""
    for name, entry in provenance["files"].items():
        file = path / _inside(path, name)
        got = file.stat().st_size if file.is_file() else "no file"
        if got != entry["bytes"]:
            raise DemoError(file, "is missing or cut.", expected=f"{entry['bytes']} bytes", got=got, hint=REBUILD)
        if file.suffix in (".parquet", ".json") and sha256_of(file) != entry["sha256"]:
            raise DemoError(file, "was changed after it was written: its SHA-256 differs.", hint=REBUILD)


def _provenance(path: Path) -> dict[str, Any]:
    """Return what we keep, sealed, beside LeRobot's files; of a dataset of others, that nothing is."""
    if not (path / PROVENANCE).is_file():
        return {"files": {}, "episodes": []}
    tree = _read_json(path / PROVENANCE)
    if tree.pop("seal", None) != hashlib.sha256(sealed(tree)).hexdigest():
        raise DemoError(path / PROVENANCE, "was changed after it was written.", hint=REBUILD)
    return tree


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
    features, told, ours = info["features"], _told(path), _provenance(path)
    spec = _recorded_spec(path, ours) or declared_spec(features)
    vectors: dict[str, Group] = (
        GROUPS if spec else {name: GROUPS.get(name, "proprio") for name in features if _is_vector(name, features)}
    )
    if ACTION not in features or (spec is None and STATE not in features):
        raise DemoError(path, f"lacks action or {STATE}; nothing can be learnt from it here.", got=sorted(features))
    shapes = {name: tuple(map(int, features[name]["shape"])) for name in (*vectors, ACTION) if name in features}
    columns = [name for name in (*vectors, *SERIES, "episode_index", ACTION, UID) if name in features]
    table = _by_episode(pa.concat_tables([_read_table(file, columns) for file in _parquets(path, "data")]))
    index = table["episode_index"].to_numpy()
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    origins = {entry["uid"]: entry for entry in ours["episodes"]}
    raw, filters, splits = dict[str, Callable[[], Raw]](), dict[str, list[str]](), _splits(info)
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(index)], strict=True):
        rows, number = table.slice(start, end - start), int(index[start])
        uid = rows[UID][0].as_py() if UID in columns else f"episode_{number:06d}"
        origin, uid = origins.get(uid, {}), distinct(raw, uid)
        row = _row(told, number)
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
        unread=() if UID in columns else tuple(_left(info, told)),
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
                return read_stills(path, _parquets(path, "data"), key, number, field.shape)[chosen]
            times = (
                rows["timestamp"].to_numpy() if "timestamp" in rows.column_names else np.arange(len(rows)) / info["fps"]
            )
            return read_clip(clip_of(path, info, row, key, field, times[chosen].astype(float)))

    return Later((len(rows), *field.shape), np.dtype(np.uint8), load)


def _told(path: Path) -> pa.Table:
    """Return what ``meta/episodes`` says of each episode: length, task texts and places in videos; no statistics."""
    tables = []
    for file in _parquets(path, "meta/episodes"):
        kept = ("episode_index", "length", "tasks")
        tables.append(
            _read_table(file, [n for n in pq.read_schema(file).names if n in kept or n.startswith("videos/")])
        )
    if sum(map(len, tables)) > MAX_EPISODES:
        got = sum(map(len, tables))
        raise DemoError(path, "has absurdly many episodes.", expected=f"at most {MAX_EPISODES}", got=got)
    return pa.concat_tables(tables, promote_options="default") if tables else pa.table({})


def _row(told: pa.Table, episode: int) -> dict[str, Any]:
    """Return the metadata of an episode, which the table may hold in any order; empty if nothing."""
    found = np.flatnonzero(told["episode_index"].to_numpy() == episode)
    return told.slice(int(found[0]), 1).to_pylist()[0] if len(found) else {}


def _instruction(told: pa.Table) -> str:
    """Return the task text that all episodes share, empty where they differ: a policy is of one instruction."""
    texts = _texts(told)
    return str(texts.pop()) if len(texts) == 1 else ""


def _texts(told: pa.Table) -> set[Any]:
    """Return the different task texts of the episodes."""
    if "tasks" not in told.column_names:
        return set()
    return {text for chunk in told["tasks"].chunks for text in chunk.flatten().unique().to_pylist()}


def _left(info: Mapping[str, Any], told: pa.Table) -> Iterator[str]:
    """Yield what a foreign dataset holds and is not read: depth, texts, and task texts that differ."""
    read = {field.name for field in camera_fields(info["features"])}
    for name, feature in sorted(info["features"].items()):
        if name.startswith("observation.") and not _is_vector(name, info["features"]) and field_name(name) not in read:
            yield f"{name} ({feature.get('dtype')})"
    if (count := len(_texts(told))) > 1:
        yield f"{count} task texts, as a policy has one instruction"


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


def _read_table(file: Path, columns: Sequence[str]) -> pa.Table:
    """Read some columns of a file, unless they would swell to far more than the file holds."""
    try:
        metadata, size = pq.read_metadata(file), file.stat().st_size
        groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
        leaves = [group.column(i) for group in groups for i in range(group.num_columns)]
        claimed = 8 * sum(leaf.num_values for leaf in leaves if leaf.path_in_schema.split(".list.")[0] in columns)
        if claimed > max(MAX_TABLE_BYTES, MAX_SWELLING * size):
            raise DemoError(file, f"has {size} bytes and claims to hold {claimed}.", hint=REBUILD)
        return pq.read_table(file, columns=list(columns), read_dictionary=[UID, TEXTS])
    except (pa.ArrowException, OSError) as error:
        raise DemoError(file, f"is cut or damaged ({error}).", hint=REBUILD) from error


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


def _check_info(path: Path, info: Mapping[str, Any]) -> None:
    if not str(info["codebase_version"]).startswith(SUPPORTED):
        raise DemoError(path, "is of another LeRobot version.", expected=f"{SUPPORTED}x", got=info["codebase_version"])
    for key in ("data_path", "video_path"):
        if info.get(key):
            _inside(path, str(info[key]))
    if info["total_episodes"] and not _parquets(path, "data"):
        raise DemoError(path / "data", "is missing.", hint=REBUILD)


def _inside(path: Path, name: str) -> PurePosixPath:
    """Return a relative path that stays within the dataset."""
    relative = PurePosixPath(name)
    if relative.is_absolute() or ".." in relative.parts:
        raise DemoError(path, "refers to a place outside itself.", got=name)
    return relative


def _parquets(path: Path, folder: str) -> list[Path]:
    return sorted((path / folder).rglob("*.parquet"))


def _count_rows(path: Path, folder: str) -> int:
    total = 0
    for file in _parquets(path, folder):
        try:
            total += pq.read_metadata(file).num_rows
        except (pa.ArrowException, OSError) as error:
            raise DemoError(file, f"is cut or damaged ({error}).", hint=REBUILD) from error
    return total


def _read_json(path: Path) -> dict[str, Any]:
    try:
        tree = read_json(path)
    except (OSError, ValueError) as error:
        raise DemoError(path, f"cannot be read ({error}).", hint=REBUILD) from error
    if not isinstance(tree, dict):
        raise DemoError(path, "is not a JSON object.", hint=REBUILD)
    return tree

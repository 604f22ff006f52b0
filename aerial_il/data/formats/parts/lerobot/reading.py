"""Read LeRobot v3 datasets, ours or foreign ones, straight from their files: nothing is opened that is not complete.

lerobot answers an incomplete dataset by asking the network for it, so completeness is checked here first.
"""

from __future__ import annotations

import hashlib
import logging
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
from aerial_il.core.specs import NO_CONTROLLER, UNKNOWN, ActionSpec, EnvSpec, Field, Group, ObservationSpec
from aerial_il.data.formats.parts.content_digest import sealed
from aerial_il.data.formats.parts.lerobot.identity import UID, declared_spec, distinct
from aerial_il.data.formats.parts.lerobot.states import PROVENANCE
from aerial_il.data.formats.parts.lerobot.videos import (
    Clip,
    camera_fields,
    clip_of,
    field_name,
    read_clip,
    wanted_cameras,
)
from aerial_il.data.source import Cameras, Raw, Source

log = logging.getLogger(__name__)
REBUILD = "Derive it anew from the recordings with: aerial-il convert"
SUPPORTED = "v3."
COLUMNS = (STATE, ENVIRONMENT, ACTION, "next.reward", "next.success", "episode_index", UID)
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


def read(path: Path, cameras: Cameras = False) -> Source:
    """Return the demonstrations of a dataset.

    What LeRobot does not hold is left empty: simulator states, controls and the scene. The last observation stands in
    for the terminal one, which is not recorded either.

    Args:
        path: of the dataset. cameras: True to decode all colour videos, or the names of some as fields, ``wrist_rgb``.

    Raises:
        DemoError: it is damaged or of another version. UnknownNameError: there is no video of such a camera.
    """
    with _typed(path):
        return _source(path, check_lerobot(path), cameras)


@contextmanager
def _typed(path: Path) -> Iterator[None]:
    """Say of which dataset it was that something in it could not be read."""
    try:
        yield
    except AerialError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"is malformed ({error!r}).", hint=REBUILD) from error


def _source(path: Path, info: Mapping[str, Any], cameras: Cameras) -> Source:
    columns = [name for name in COLUMNS if name in info["features"]]
    table = pa.concat_tables([_read_table(file, columns) for file in _parquets(path, "data")])
    index = table["episode_index"].to_numpy()
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    ends = np.append(starts[1:], len(index))
    told, ours = _told(path), _provenance(path)
    origins = {entry["uid"]: entry for entry in ours["episodes"]}
    spec = _recorded_spec(path, ours) or declared_spec(info["features"]) or _spec(path, info, table, _instruction(told))
    seen = wanted_cameras(cameras, camera_fields(info["features"]))
    if UID not in columns:
        _say_what_is_left(path, info, told)
    raw: dict[str, Callable[[], Raw]] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        rows, number = table.slice(start, end - start), int(index[start])
        uid = rows[UID][0].as_py() if UID in columns else f"episode_{number:06d}"
        origin, uid = origins.get(uid, {}), distinct(raw, uid)
        clips = {f.name: partial(_clip, path, info, told, number, f) for f in seen}
        raw[uid] = partial(_raw, path, rows, spec, origin, clips)
    return Source(path=path, kind="a LeRobot dataset", raw=raw, spec=spec)


def _clip(path: Path, info: Mapping[str, Any], told: pa.Table, episode: int, field: Field) -> Clip:
    return clip_of(path, info, _row(told, episode), field)


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


def _say_what_is_left(path: Path, info: Mapping[str, Any], told: pa.Table) -> None:
    """Warn of what a foreign dataset holds and is not read: task texts that differ, depth, pictures inside Parquet."""
    read = {field.name for field in camera_fields(info["features"])}
    pictures = [name for name, feature in info["features"].items() if feature.get("dtype") in ("video", "image")]
    left = sorted(name for name in pictures if field_name(name) not in read)
    if (count := len(_texts(told))) > 1:
        left.append(f"{count} task texts, as a policy has one instruction")
    if left:
        log.warning("%s: not read: %s.", path, "; ".join(left))


def _labels(feature: Mapping[str, Any], size: int) -> tuple[str, ...]:
    """Return the names of a vector's elements, in a list or by kind as ``{"motors": [...]}``; none if not given."""
    names = feature.get("names")
    names = next(iter(names.values()), None) if isinstance(names, dict) and len(names) == 1 else names
    labels = tuple(map(str, names)) if isinstance(names, list) else ()
    return labels if len(labels) == size == len(set(labels)) else ()


def _raw(
    path: Path, rows: pa.Table, spec: EnvSpec, origin: Mapping[str, Any], clips: Mapping[str, Callable[[], Clip]]
) -> Raw:
    """Return a demonstration, its pictures decoded anew each time: all of them may not fit into memory."""
    with _typed(path):
        obs = {name: read_clip(clip()) for name, clip in clips.items()}
        for column, group in GROUPS.items():
            fields, end = spec.observation.of_group(group), 0
            values = _matrix(path, rows, column, sum(f.size for f in fields)) if fields else np.zeros((len(rows), 0))
            for field in fields:
                start, end = end, end + field.size
                obs[field.name] = values[:, start:end].reshape(len(rows), *field.shape)
        success = rows["next.success"].to_numpy()[-1] if "next.success" in rows.column_names else None
        return Raw(
            obs=obs,
            actions=_matrix(path, rows, ACTION, spec.action.size),
            rewards=rows["next.reward"].to_numpy() if "next.reward" in rows.column_names else None,
            success=bool(origin.get("success", True) if success is None else success),
            provenance=origin.get("provenance", {"policy": UNKNOWN}),
        )


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


def _matrix(path: Path, rows: pa.Table, column: str, width: int) -> np.ndarray:
    """Return a column of vectors as (T, D) float64, exact."""
    flat = rows[column].combine_chunks().flatten() if pa.types.is_nested(rows[column].type) else rows[column]
    values = np.asarray(flat, float)
    if values.size != len(rows) * width:
        raise DemoError(path, "has a column of another width.", field=column, expected=width)
    return values.reshape(len(rows), width)


def _recorded_spec(path: Path, provenance: Mapping[str, Any]) -> EnvSpec | None:
    try:
        return EnvSpec.from_dict(provenance["spec"]) if "spec" in provenance else None
    except AerialError as error:
        raise DemoError(path / PROVENANCE, f"has a malformed specification ({error}).") from error


def _spec(path: Path, info: Mapping[str, Any], table: pa.Table, instruction: str) -> EnvSpec:
    """Return what can be read off a foreign dataset's columns; the bounds are those of the actions seen."""
    features = info["features"]
    if ACTION not in features or STATE not in features:
        raise DemoError(path, f"lacks action or {STATE}; nothing can be learnt from it here.", got=sorted(features))
    fields = [_vector(name, features[name], group) for name, group in GROUPS.items() if name in features]
    size = int(features[ACTION]["shape"][0])
    actions = _matrix(path, table, ACTION, size)
    labels = _labels(features[ACTION], size) or tuple(str(i) for i in range(size))
    action = ActionSpec(UNKNOWN, labels, ("",) * size, actions.min(0) - 1e-6, actions.max(0) + 1e-6)
    return EnvSpec(
        robot=str(info.get("robot_type") or UNKNOWN),
        task=UNKNOWN,
        tier=UNKNOWN,
        observation=ObservationSpec((*fields, *camera_fields(features))),
        action=action,
        control_dt_s=1 / info["fps"],
        max_steps=int(info["total_frames"]),
        instruction=instruction,
        subtasks=(),
        state_size=0,
        controller=NO_CONTROLLER,
    )


def _vector(name: str, feature: Mapping[str, Any], group: Group) -> Field:
    shape = tuple(feature["shape"])
    return Field(name, shape, group, labels=_labels(feature, int(shape[0])) if len(shape) == 1 else ())


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

"""Files of a LeRobot dataset: whole, inside its folder, as they were written, and no larger in memory than they claim.

lerobot answers an incomplete dataset by asking the network for it, so completeness is checked before one is opened.
"""

import hashlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from aerial_il.core.bounded import read_json
from aerial_il.core.errors import DemoError, StorageError
from aerial_il.core.files import sha256_of
from aerial_il.data.formats.parts.content_digest import sealed
from aerial_il.data.formats.parts.lerobot.identity import UID
from aerial_il.data.formats.parts.lerobot.states import PROVENANCE
from aerial_il.data.memory import scratch_folder

REBUILD = "Derive it anew from the recordings with: aerial-il convert"
SUPPORTED, OLDER = "v3.", "v2.1"
CONVERTER = "python -m lerobot.scripts.convert_dataset_v21_to_v30 --repo-id=NAME --root={} --push-to-hub=false"
MAX_TABLE_BYTES = 160 << 20
HELD_BYTES = 64 << 20  # of files whose rows are held in memory
MAX_SWELLING = 8  # times the bytes of a file that its columns may take
TEXTS = "tasks.list.element"  # of episodes; a text that repeats is kept once, as a demo.uid is


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
    _check_files(path, provenance(path))
    return info


def altered_files(path: Path) -> list[Path]:
    """Return the files of a dataset whose SHA-256 differs from what was written, videos included."""
    listed = {path / _inside(path, name): entry["sha256"] for name, entry in provenance(path)["files"].items()}
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


def provenance(path: Path) -> dict[str, Any]:
    """Return what we keep, sealed, beside LeRobot's files; of a dataset of others, that nothing is."""
    if not (path / PROVENANCE).is_file():
        return {"files": {}, "episodes": []}
    tree = _read_json(path / PROVENANCE)
    if tree.pop("seal", None) != hashlib.sha256(sealed(tree)).hexdigest():
        raise DemoError(path / PROVENANCE, "was changed after it was written.", hint=REBUILD)
    return tree


def _check_info(path: Path, info: Mapping[str, Any]) -> None:
    if not str(version := info["codebase_version"]).startswith(SUPPORTED):
        hint = f"LeRobot itself converts it, in place: {CONVERTER.format(path)}" if version == OLDER else ""
        raise DemoError(path, "is of another LeRobot version.", expected=f"{SUPPORTED}x", got=version, hint=hint)
    for key in ("data_path", "video_path"):
        if info.get(key):
            _inside(path, str(info[key]))
    if info["total_episodes"] and not parquets(path, "data"):
        raise DemoError(path / "data", "is missing.", hint=REBUILD)


def _inside(path: Path, name: str) -> PurePosixPath:
    """Return a relative path that stays within the dataset."""
    relative = PurePosixPath(name)
    if relative.is_absolute() or ".." in relative.parts:
        raise DemoError(path, "refers to a place outside itself.", got=name)
    return relative


def parquets(path: Path, folder: str) -> list[Path]:
    return sorted((path / folder).rglob("*.parquet"))


def _count_rows(path: Path, folder: str) -> int:
    total = 0
    for file in parquets(path, folder):
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


def read_table(file: Path, columns: Sequence[str]) -> pa.Table:
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


def read_rows(path: Path, columns: Sequence[str]) -> pa.Table:
    """Return some columns of all rows, file after file; of a large dataset they lie on disk, and vanish with the table.

    Raises:
        StorageError: the disk has no room for that file.
    """
    files = parquets(path, "data")
    if sum(file.stat().st_size for file in files) <= HELD_BYTES:
        return pa.concat_tables([read_table(file, columns) for file in files])
    try:
        with tempfile.NamedTemporaryFile(dir=scratch_folder()) as scratch:
            _write_rows(scratch, (read_table(file, columns) for file in files))
            return pa.ipc.open_stream(pa.memory_map(scratch.name)).read_all()  # mapped, it outlives its name
    except OSError as error:
        raise StorageError(scratch_folder(), error, "Name a disk with more room in TMPDIR.") from error


def _write_rows(scratch: IO[bytes], tables: Iterator[pa.Table]) -> None:
    """Write tables one after the other so that they can be used where they lie."""
    first = next(tables)
    with pa.ipc.new_stream(scratch, first.schema) as writer:
        for table in chain((first,), tables):
            writer.write_table(table)
    scratch.flush()

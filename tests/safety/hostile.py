"""Files and folders of strangers, each made to run code, to reach outside of itself or to swell."""

import hashlib
import io
import json
import os
import pickle
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
import zstandard
from mcap.records import Header

from aerial_il.core.checkpoint import ARRAYS, CONFIG, STATE, _sealed
from aerial_il.data.recording.container import MAGIC, record_bytes
from tests.data.tampering import rewrite

SCRIPT = "<script>document.title='owned'</script><img src=x onerror=alert(1)>"


@dataclass(frozen=True)
class Sound:
    """What the attacks are made from: a dataset, its derived forms, a run; and where a success would be seen.

    Attributes:
        canary: a file that only code out of a stranger's file would make.
        victim: a folder outside, of which nothing may be changed or shown.
    """

    dataset: Path
    hdf5: Path
    lerobot: Path
    minari: Path
    run: Path
    canary: Path
    victim: Path

    @property
    def recording(self) -> Path:
        return sorted((self.dataset / "demos").glob("*.mcap"))[0]


class _Touch:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return os.system, (f"touch {self.path}",)


def _copy(source: Path, target: Path) -> Path:
    return Path(shutil.copytree(source, target, symlinks=True))


def _sealed_policy(run: Path, **files: bytes) -> None:
    """Replace files of a run's policy and seal it anew, as anybody can."""
    folder = run / "policy"
    names = {"arrays": ARRAYS, "state": STATE, "config": CONFIG}
    content = {name: files.get(key) or (folder / name).read_bytes() for key, name in names.items()}
    for name, data in _sealed(content).items():
        (folder / name).write_bytes(data)


def _with_settings(sound: Sound, to: Path, **changes: object) -> Path:
    run = _copy(sound.run, to)
    config = yaml.safe_load((run / "policy" / CONFIG).read_text())
    for path, value in changes.items():
        *place, last = path.split("__")
        inner = config
        for name in place:
            inner = inner[name]
        inner[last] = value
    _sealed_policy(run, config=yaml.safe_dump(config).encode())
    return run


def policy_by_path(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, policy="../../../bait")


def policy_by_module(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, policy="bait", settings__target_="bait.Bait")


def policy_of_petabytes(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, settings__hidden=[10**7, 10**7, 10**7])


def policy_of_many_layers(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, settings__hidden=[1] * 100_000)


def policy_that_chooses_forever(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, settings__chunk=10**9)


def policy_spec_imports(sound: Sound, to: Path) -> Path:
    return _with_settings(sound, to, spec__task="bait:Bait-v0", spec__robot="gymnasium")


def policy_pickled(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    _sealed_policy(run, arrays=pickle.dumps(_Touch(sound.canary)), state=pickle.dumps(_Touch(sound.canary)))
    return run


def policy_torch_file(sound: Sound, to: Path) -> Path:
    import torch

    file = to.with_suffix(".pt")
    torch.save(_Touch(sound.canary), file)
    return file


def policy_npz_of_objects(sound: Sound, to: Path) -> Path:
    file = to.with_suffix(".npz")
    np.savez(file, told=np.array([_Touch(sound.canary)], dtype=object))
    return file


def safetensors_lies(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    header = json.dumps({"w": {"dtype": "F64", "shape": [10**6, 10**6], "data_offsets": [0, 8]}}).encode()
    _sealed_policy(run, arrays=struct.pack("<Q", len(header)) + header + bytes(8))
    return run


def safetensors_long_header(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    _sealed_policy(run, arrays=struct.pack("<Q", 2**62) + b"{}")
    return run


BOMB = "a0: &a0 [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 30)
)


def run_of_aliases(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    (run / "config.yaml").write_text(BOMB)
    _sealed_policy(run, config=BOMB.encode())
    return run


def run_of_tags(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    text = f"policy: !!python/object/apply:os.system ['touch {sound.canary}']\n"
    (run / "config.yaml").write_text(text)
    _sealed_policy(run, config=text.encode())
    return run


def run_of_digits(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    (run / "config.yaml").write_text("seed: " + "1" + ":1" * 400_000)
    return run


def run_of_brackets(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    (run / "metrics.jsonl").write_text("[" * 3_000_000 + "\n")
    return run


def run_with_script(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    rows = [{"step": step, f"loss/{SCRIPT}": 1.0 / step, "loss": 1.0} for step in (1, 2, 3)]
    (run / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (run / "config.yaml").write_text(yaml.safe_dump({"policy": SCRIPT, "settings": {SCRIPT: SCRIPT}, "seed": 0}))
    (run / "provenance.json").write_text(json.dumps({"commit": SCRIPT, SCRIPT: SCRIPT}))
    return run


def run_with_bad_numbers(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    rows = '{"step": 1e999, "loss": NaN}\n{"step": -1, "loss": 1e999}\n{"step": "x"}\n'
    (run / "metrics.jsonl").write_text(rows)
    return run


def run_of_links(sound: Sound, to: Path) -> Path:
    """Everything that a run appends to, cuts or deletes is another's."""
    run = _copy(sound.run, to)
    for name in ("metrics.jsonl", ".lock"):
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(sound.victim / "precious.txt")
    shutil.rmtree(run / "checkpoints", ignore_errors=True)
    (run / "checkpoints").symlink_to(sound.victim / "numbers")
    shutil.rmtree(run / "policy")
    return run


def run_s_home_of_links(sound: Sound, to: Path) -> Path:
    """What is written beside runs, and where they are put away, is another's."""
    _copy(sound.run, to / "mine")
    (to / "trash").symlink_to(sound.victim)
    (to / "report.html").symlink_to(sound.victim / "precious.txt")
    return to


def run_of_pipes(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    for name in ("config.yaml", "policy/manifest.json"):
        (run / name).unlink()
        os.mkfifo(run / name)
    return run


def run_of_devices(sound: Sound, to: Path) -> Path:
    run = _copy(sound.run, to)
    for name in ("config.yaml", "metrics.jsonl", "policy/manifest.json"):
        (run / name).unlink()
        (run / name).symlink_to("/dev/zero")
    return run


def index_of_aliases(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.dataset, to)
    (folder / "dataset.yaml").write_text(BOMB)
    return folder


def index_of_tags(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.dataset, to)
    (folder / "dataset.yaml").write_text(f"spec: !!python/object/apply:os.system ['touch {sound.canary}']\n")
    return folder


def recordings_of_links(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.dataset, to)
    file = sorted((folder / "demos").glob("*.mcap"))[0]
    file.unlink()
    file.symlink_to(sound.victim / "precious.txt")
    (folder / "recordings.jsonl").unlink(missing_ok=True)
    (folder / "recordings.jsonl").symlink_to(sound.victim / "precious.txt")
    return folder


def recordings_of_devices(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.dataset, to)
    first, second = sorted((folder / "demos").glob("*.mcap"))[:2]
    first.unlink()
    first.symlink_to("/dev/zero")
    second.unlink()
    os.mkfifo(second)
    return folder


def _chunk(content: bytes, *, declared: int | None = None) -> bytes:
    packed = zstandard.ZstdCompressor(level=3).compress(content)
    size = len(content) if declared is None else declared
    body = (
        struct.pack("<QQQI", 0, 0, size, zlib.crc32(content)) + struct.pack("<I4sQ", 4, b"zstd", len(packed)) + packed
    )
    return struct.pack("<BQ", 6, len(body)) + body


def _mcap(to: Path, *records: bytes) -> Path:
    raw = MAGIC + record_bytes(Header("ros2", "bomb")) + b"".join(records)
    to.mkdir()
    (to / "bomb.mcap").write_bytes(raw + struct.pack("<BQI", 0x0F, 4, zlib.crc32(raw)))
    return to


def _messages(count: int, channels: int) -> bytes:
    heads = (struct.pack("<BQHIQQ", 5, 22, 1 + i % channels, i % 7, 0, 0) for i in range(14))
    return b"".join(heads) * (count // 14)


def mcap_of_messages(sound: Sound, to: Path) -> Path:
    return _mcap(to, _chunk(_messages(5_000_000, 1)))


def mcap_of_unlike_messages(sound: Sound, to: Path) -> Path:
    content = _messages(4_000_000, 2) + struct.pack("<BQHIQQ", 5, 23, 1, 0, 0, 0) + b"\0"
    return _mcap(to, _chunk(content))


def mcap_of_many_chunks(sound: Sound, to: Path) -> Path:
    return _mcap(to, *[_chunk(bytes(100 << 20))] * 2, *[_chunk(_messages(1_000_000, 1))] * 8)


def mcap_lies_about_its_chunk(sound: Sound, to: Path) -> Path:
    return _mcap(to, _chunk(_messages(1400, 1), declared=2**62))


def mcap_of_definitions(sound: Sound, to: Path) -> Path:
    many = (struct.pack("<HI", i % 65536, 1) + b"x" + struct.pack("<I", 0) * 2 for i in range(1, 60_000))
    return _mcap(to, *(struct.pack("<BQ", 3, len(body)) + body for body in many))


def _mcap_of_spec(sound: Sound, to: Path, change: Callable[[dict], dict], **entries: str) -> Path:
    def metadata(old: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
        episode = old["aerial_il.episode"]
        spec = json.dumps(change(json.loads(episode["spec"])))
        return {**old, "aerial_il.episode": {**episode, "spec": spec, **entries}}

    to.mkdir()
    rewrite(sound.recording, to / "bomb.mcap", metadata=metadata)
    return to


def mcap_of_fields(sound: Sound, to: Path) -> Path:
    field = {"shape": [1_000_000], "group": "proprio", "dtype": "float64", "unit": "", "labels": []}
    fields = [{"name": f"f{i}", **field} for i in range(200)]
    return _mcap_of_spec(sound, to, lambda spec: {**spec, "observation": {"fields": fields}})


def mcap_of_negative_shapes(sound: Sound, to: Path) -> Path:
    field = {"shape": [-1, -(10**9)], "group": "image", "dtype": "float64", "unit": "", "labels": []}
    return _mcap_of_spec(sound, to, lambda spec: {**spec, "observation": {"fields": [{"name": "f", **field}]}})


def mcap_spec_imports(sound: Sound, to: Path) -> Path:
    return _mcap_of_spec(sound, to, lambda spec: {**spec, "robot": "gymnasium", "task": "bait:Bait-v0"})


def _hdf5(sound: Sound, to: Path, change: Callable[[h5py.File], None]) -> Path:
    file = Path(shutil.copyfile(sound.hdf5, to.with_suffix(".hdf5")))
    with h5py.File(file, "a") as raw:
        change(raw)
    return file


def _with_actions(raw: h5py.File, described: Mapping[str, Any]) -> None:
    data: Any = raw["data"]
    for demo in data.values():
        del demo["actions"]
        demo.create_dataset("actions", **described)


def hdf5_of_fill_values(sound: Sound, to: Path) -> Path:
    huge = {"shape": (10**9, 6), "dtype": "f8", "chunks": (1000, 6), "fillvalue": 1.0}
    return _hdf5(sound, to, lambda raw: _with_actions(raw, huge))


def hdf5_of_many_columns(sound: Sound, to: Path) -> Path:
    def change(raw: h5py.File) -> None:
        data: Any = raw["data"]
        for demo in data.values():
            del demo["aerial_il"]
            for i in range(200):
                demo.create_dataset(f"obs/f{i}", (10**6, 8), "f8", chunks=(1000, 8))

    return _hdf5(sound, to, change)


def hdf5_links_outside(sound: Sound, to: Path) -> Path:
    def change(raw: h5py.File) -> None:
        data: Any = raw["data"]
        for demo in data.values():
            del demo["rewards"], demo["actions"], demo["states"]
            demo["rewards"] = h5py.ExternalLink(str(sound.victim / "other.hdf5"), "/x")
            demo["actions"] = h5py.SoftLink("/data")
            secret = str(sound.victim / "precious.txt")
            demo.create_dataset("states", (8,), "u1", external=[(secret, 0, 8)])

    return _hdf5(sound, to, change)


def hdf5_of_objects(sound: Sound, to: Path) -> Path:
    text = {"shape": (50,), "dtype": h5py.string_dtype()}
    return _hdf5(sound, to, lambda raw: _with_actions(raw, text))


def hdf5_that_is_a_pipe(sound: Sound, to: Path) -> Path:
    os.mkfifo(to.with_suffix(".hdf5"))
    return to.with_suffix(".hdf5")


def _lerobot(sound: Sound, to: Path, **info: object) -> Path:
    folder = _copy(sound.lerobot, to)
    (folder / "meta" / "provenance.json").unlink()
    told = json.loads((folder / "meta" / "info.json").read_text())
    (folder / "meta" / "info.json").write_text(json.dumps({**told, **info}))
    return folder


def lerobot_of_rows(sound: Sound, to: Path) -> Path:
    rows = 8_000_000
    folder = _lerobot(sound, to, total_frames=rows)
    file = sorted((folder / "data").rglob("*.parquet"))[0]
    table = pq.read_table(file).slice(0, 1)
    for extra in sorted((folder / "data").rglob("*.parquet"))[1:]:
        extra.unlink()
    columns = {name: pa.repeat(table[name][0].as_py() or 0, rows) for name in ("episode_index", "next.reward")}
    columns["action"] = pa.FixedSizeListArray.from_arrays(pa.repeat(0.5, 6 * rows), 6)
    pq.write_table(pa.table(columns), file, compression="zstd")
    return folder


def lerobot_names_outside(sound: Sound, to: Path) -> Path:
    return _lerobot(sound, to, data_path=f"../../{sound.victim.name}/{{chunk_index}}.parquet")


def lerobot_without_rate(sound: Sound, to: Path) -> Path:
    return _lerobot(sound, to, fps=0, features=[], robot_type={SCRIPT: 1})


def lerobot_spec_imports(sound: Sound, to: Path) -> Path:
    folder = _lerobot(sound, to)
    info = json.loads((folder / "meta" / "info.json").read_text())
    spec = json.loads(info["features"]["demo.uid"]["names"][0])
    info["features"]["demo.uid"]["names"] = [json.dumps({**spec, "robot": "gymnasium", "task": "bait:Bait-v0"})]
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def lerobot_of_brackets(sound: Sound, to: Path) -> Path:
    folder = _lerobot(sound, to)
    (folder / "meta" / "info.json").write_text("[" * 1_000_000)
    return folder


def _minari(sound: Sound, to: Path, change: Callable[[h5py.File], None] | None = None, **told: object) -> Path:
    """Return a copy with changed arrays and metadata; of metadata that are None nothing is left."""
    folder = _copy(sound.minari, to)
    if change is not None:
        with h5py.File(folder / "data" / "main_data.hdf5", "a") as raw:
            change(raw)
    metadata = folder / "data" / "metadata.json"
    kept = {**json.loads(metadata.read_text()), **told}
    metadata.write_text(json.dumps({name: value for name, value in kept.items() if value is not None}))
    return folder


def _in_each(name: str, **described: Any) -> Callable[[h5py.File], None]:
    """Return a change that puts another dataset in the place of ``name`` in all episodes."""

    def change(raw: h5py.File) -> None:
        for episode in map(str, raw):
            del raw[episode][name]  # type: ignore[attr-defined]
            raw[episode].create_dataset(name, **described)  # type: ignore[union-attr]

    return change


def minari_spec_imports(sound: Sound, to: Path) -> Path:
    told = json.dumps({"id": "bait:Bait-v0", "entry_point": "bait:Bait"})
    return _minari(sound, to, env_spec=told, eval_env_spec=told, aerial_il_spec=None)


def minari_own_spec_imports(sound: Sound, to: Path) -> Path:
    spec = json.loads(json.loads((sound.minari / "data" / "metadata.json").read_text())["aerial_il_spec"])
    return _minari(sound, to, aerial_il_spec=json.dumps({**spec, "robot": "gymnasium", "task": "bait:Bait-v0"}))


def minari_own_spec_lies(sound: Sound, to: Path) -> Path:
    spec = json.loads(json.loads((sound.minari / "data" / "metadata.json").read_text())["aerial_il_spec"])
    field = {"name": SCRIPT, "shape": [10**9, -1], "group": "image", "dtype": "float64", "unit": "", "labels": []}
    return _minari(sound, to, aerial_il_spec=json.dumps({**spec, "observation": {"fields": [field]}}))


def minari_of_brackets(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.minari, to)
    (folder / "data" / "metadata.json").write_text("[" * 1_000_000)
    return folder


def minari_of_fill_values(sound: Sound, to: Path) -> Path:
    huge = {"shape": (10**9, 4), "dtype": "f8", "chunks": (1000, 4), "fillvalue": 1.0}
    return _minari(sound, to, _in_each("observations", **huge))


def minari_of_small_numbers(sound: Sound, to: Path) -> Path:
    """Bytes that take eight times their size as the numbers that are worked with."""
    huge = {"shape": (10**8,), "dtype": "?", "chunks": (10**6,), "compression": "gzip"}
    return _minari(sound, to, _in_each("truncations", **huge))


def minari_of_texts(sound: Sound, to: Path) -> Path:
    return _minari(sound, to, _in_each("observations", shape=(50,), dtype=h5py.string_dtype()))


def minari_links_outside(sound: Sound, to: Path) -> Path:
    def change(raw: h5py.File) -> None:
        for number, name in enumerate(map(str, list(raw))):
            episode: Any = raw[name]
            del episode["rewards"], episode["actions"]
            episode["rewards"] = h5py.ExternalLink(str(sound.victim / "other.hdf5"), "/x")
            secret = str(sound.victim / "precious.txt")
            episode.create_dataset("actions", (1, 8), "u1", external=[(secret, 0, 8)])
            raw[f"episode_{number + 100}"] = h5py.SoftLink("/")

    return _minari(sound, to, change)


def minari_of_links(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.minari, to)
    for name in ("main_data.hdf5", "metadata.json"):
        (folder / "data" / name).unlink()
        (folder / "data" / name).symlink_to(sound.victim / "precious.txt")
    return folder


def minari_of_devices(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.minari, to)
    (folder / "data" / "metadata.json").unlink()
    (folder / "data" / "metadata.json").symlink_to("/dev/zero")
    return folder


def minari_of_pipes(sound: Sound, to: Path) -> Path:
    folder = _copy(sound.minari, to)
    for name in ("main_data.hdf5", "metadata.json"):
        (folder / "data" / name).unlink()
        os.mkfifo(folder / "data" / name)
    return folder


def evaluation_with_script(sound: Sound, to: Path) -> Path:
    out = _copy(sound.run.parent / "judged", to)
    raw = json.loads((out / "evaluation.json").read_text())
    raw |= {"robot": SCRIPT, "task": SCRIPT, "tier": SCRIPT, "policy": SCRIPT}
    raw["provenance"] = {**raw["provenance"], SCRIPT: SCRIPT, "command": [SCRIPT]}
    (out / "evaluation.json").write_text(json.dumps(raw))
    return out


def evaluation_of_objects(sound: Sound, to: Path) -> Path:
    out = _copy(sound.run.parent / "judged", to)
    held: Any = {"10000": np.array([_Touch(sound.canary)], dtype=object)}
    np.savez(out / "paths.npz", **held)
    return out


def evaluation_that_swells(sound: Sound, to: Path) -> Path:
    out = _copy(sound.run.parent / "judged", to)
    head = io.BytesIO()
    np.lib.format.write_array_header_2_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**8, 3)})
    with (
        zipfile.ZipFile(out / "paths.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("10000.npy", "w") as file,
    ):
        file.write(head.getvalue())
        for _ in range(300):
            file.write(bytes(1 << 20))
    return out


def wrong_places(sound: Sound, to: Path) -> Path:
    return Path("/dev/zero")


def a_loop(sound: Sound, to: Path) -> Path:
    to.symlink_to(to.name)
    return to


ATTACKS: dict[str, Any] = {
    name: made
    for name, made in sorted(globals().items())
    if callable(made) and getattr(made, "__module__", "") == __name__ and name[0].islower() and name != "rewrite"
}


def trace(folder: Path) -> str:
    """Return a digest of everything in a folder."""
    sha = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        sha.update(f"{path} {path.lstat().st_mode}".encode() + (path.read_bytes() if path.is_file() else b""))
    return sha.hexdigest()

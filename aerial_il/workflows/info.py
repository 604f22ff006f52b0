"""What a dataset holds: the environment, its fields, how its episodes were made, and each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerial_il.data.reading import Reading

MADE_BY = ("task", "tier", "controller", "policy", "settings", "engine")
DESCRIBED = ("uid", *MADE_BY, "seed", "steps", "seconds", "success", "return")
CACHE = Path("cache", "info.json")  # below a folder of recordings

if TYPE_CHECKING:
    from aerial_il.collection.collect import Collection
    from aerial_il.core.specs import EnvSpec
    from aerial_il.data.dataset import Dataset
    from aerial_il.data.episode import Episode


@dataclass(frozen=True, kw_only=True)
class Info(Reading):
    """Which dataset.

    Attributes:
        path: dataset, or one file.
    """

    path: str


def info(settings: Info) -> dict[str, Any]:
    """Return the description, in plain values."""
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import name_of

    dataset = open_dataset(settings.path, **settings.answers, failures=True, states=False)
    episodes, spec = _episodes(dataset), dataset.spec
    lies = {"path": settings.path, "format": name_of(Path(settings.path)), "foreign": spec.is_foreign}
    return {**lies, **_environment(spec), **_composition(episodes), "episodes": episodes}


def remember(recorded: Collection, spec: EnvSpec) -> None:
    """Keep what is said of episodes that were just recorded, so that they need not be read for it."""
    from aerial_il.data.folder import DEMOS, FAILURES

    folder, origin, known = recorded.folder, recorded.provenance, _known(recorded.folder.path / CACHE)
    rows = dict(known)
    for uid, flown in recorded.flights.items():
        row = _described(uid, spec, origin, flown.seed, flown.steps, flown.success, flown.total_reward)
        rows[uid] = _stamp(folder.file(uid, DEMOS if flown.success else FAILURES)), row
    _write(folder.path / CACHE, known, rows)


def _episodes(dataset: Dataset) -> list[dict[str, Any]]:
    """Describe each episode; a recording that was described before, and has not changed since, is not read again."""
    cache, known = dataset.path / CACHE, _known(dataset.path / CACHE)
    stamps = {uid: _stamp(file) for uid, file in dataset.files.items()}
    rows = {uid: row for uid, (stamp, row) in known.items() if stamps.get(uid) == stamp}
    if unknown := [uid for uid in dataset.uids if uid not in rows]:
        rows |= {episode.uid: _episode(episode) for episode in dataset.only(unknown)}
        if stamps and dataset.path.is_dir():
            _write(cache, known, {uid: (stamp, rows[uid]) for uid, stamp in stamps.items() if uid in rows})
    return [rows[uid] for uid in dataset.uids if uid in rows]


def _stamp(file: Path) -> list[int]:
    """Return what changes with a file: its size and the time of its last change."""
    found = file.stat()
    return [found.st_size, found.st_mtime_ns]


def _write(cache: Path, known: Mapping[str, Any], rows: Mapping[str, Any]) -> None:
    """Write what was said of each file beside its stamp, over what is known of them, if the place is ours."""
    from aerial_il.core.files import write_json

    if (known or not cache.exists()) and not cache.parent.is_symlink():
        with suppress(OSError):  # somebody else's folder
            cache.parent.mkdir(exist_ok=True)
            write_json(cache, rows)


def _known(cache: Path) -> dict[str, Any]:
    """Return uid -> stamp of the file and what was said of it; nothing where the file is missing or none of ours."""
    from aerial_il.core.bounded import read_json

    try:
        found = read_json(cache)
        return {uid: (stamp, row) for uid, (stamp, row) in found.items() if row.keys() == {*DESCRIBED}}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _composition(episodes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Count the episodes by how they were made, and name the seeds that several of a task were flown with."""
    made = Counter(tuple(e[key] for key in MADE_BY) for e in episodes)
    won = Counter(tuple(e[key] for key in MADE_BY) for e in episodes if e["success"])
    seeds = Counter((e["task"], e["seed"]) for e in episodes if e["seed"] is not None)
    counts = [dict(zip(MADE_BY, how, strict=True)) | {"episodes": n, "successful": won[how]} for how, n in made.items()]
    return {"made_by": counts, "repeated_seeds": sorted({seed for (_, seed), count in seeds.items() if count > 1})}


def _environment(spec: Any) -> dict[str, Any]:
    fields = [
        {"name": f.name, "shape": list(f.shape), "group": f.group, "unit": f.unit} for f in spec.observation.fields
    ]
    return {
        "robot": spec.robot,
        "task": spec.task,
        "tier": spec.tier,
        "controller": spec.controller,
        "instruction": spec.instruction,
        "action": {"level": spec.action.level, "elements": list(spec.action.labels)},
        "control_dt_s": spec.control_dt_s,
        "fields": fields,
    }


def _episode(episode: Episode) -> dict[str, Any]:
    seed = episode.provenance.get("seed")
    flown = len(episode), bool(episode.success), float(episode.rewards.sum())
    return _described(episode.uid, episode.spec, episode.provenance, seed, *flown)


def _described(
    uid: str, spec: EnvSpec, origin: Mapping[str, Any], seed: Any, steps: int, success: bool, total_reward: float
) -> dict[str, Any]:
    from aerial_il.data.provenance import engine_of

    return {
        "uid": uid,
        "task": spec.task,
        "tier": origin.get("tier", spec.tier),
        "controller": origin.get("controller", spec.controller),
        "policy": str(origin.get("policy", "unknown")),
        "settings": " ".join(f"{key}={value}" for key, value in sorted(dict(origin.get("settings", {})).items())),
        "engine": None if spec.is_outside else engine_of(origin),
        "seed": seed,
        "steps": steps,
        "seconds": round(steps * spec.control_dt_s, 2),
        "success": success,
        "return": round(total_reward, 2),
    }

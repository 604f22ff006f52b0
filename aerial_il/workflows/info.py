"""What a dataset holds: the environment, its fields, how its episodes were made, and each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from aerial_il.data.columns import MADE_BY
from aerial_il.data.reading import Reading

if TYPE_CHECKING:
    from aerial_il.collection.collect import Collection
    from aerial_il.core.specs import EnvSpec


@dataclass(frozen=True, kw_only=True)
class Info(Reading):
    """Which dataset.

    Attributes:
        path: dataset, or one file.
        where: only the episodes for which this holds, e.g. 'success and seconds < 12'.
    """

    path: str
    where: str | None = None


def info(settings: Info) -> dict[str, Any]:
    """Return the description, in plain values."""
    from aerial_il.data.curation.selection import select
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats import name_of
    from aerial_il.data.table import read_table

    dataset = open_dataset(settings.path, **settings.answers, failures=True, states=False)
    episodes = read_table(dataset) if settings.where is None else select(dataset, settings.where)
    spec = dataset.spec
    lies = {"path": settings.path, "format": name_of(dataset.path), "foreign": spec.is_foreign}
    return {**lies, **_environment(spec), **_composition(episodes), "episodes": episodes}


def remember(recorded: Collection, spec: EnvSpec) -> None:
    """Keep what is said of episodes that were just recorded, so that they need not be read for it."""
    from aerial_il.data import table
    from aerial_il.data.folder import DEMOS, FAILURES

    folder, rows = recorded.folder, []
    for uid, flown in recorded.flights.items():
        said = {name: getattr(flown, name) for name in ("steps", "failure", "phase", "total_reward")}
        row = table.describe(uid, spec, {**recorded.provenance, "seed": flown.seed}, **said)
        rows.append((folder.file(uid, FAILURES if flown.failure else DEMOS), row))
    table.remember(folder.path, rows)


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

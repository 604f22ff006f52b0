"""What a dataset holds: the environment, its fields, how its episodes were made, and each of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.workflows.parts.reading import Reading

MADE_BY = ("task", "tier", "controller", "policy", "settings", "engine")


@dataclass(frozen=True, kw_only=True)
class Info(Reading):
    """Which dataset.

    Attributes:
        path: dataset, or one file.
    """

    path: str


def info(settings: Info) -> dict[str, Any]:
    """Return the description, in plain values."""
    dataset = settings.open(settings.path, failures=True, states=False)
    episodes = [_episode(e) for e in dataset]
    return {"path": settings.path, **_environment(dataset.spec), **_composition(episodes), "episodes": episodes}


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


def _episode(episode: Any) -> dict[str, Any]:
    origin, spec = episode.provenance, episode.spec
    from aerial_il.data.provenance import engine_of

    return {
        "uid": episode.uid,
        "task": spec.task,
        "tier": origin.get("tier", spec.tier),
        "controller": origin.get("controller", spec.controller),
        "policy": str(origin.get("policy", "unknown")),
        "settings": " ".join(f"{key}={value}" for key, value in sorted(dict(origin.get("settings", {})).items())),
        "engine": None if spec.is_outside else engine_of(origin),
        "seed": origin.get("seed"),
        "steps": len(episode),
        "seconds": round(len(episode) * episode.spec.control_dt_s, 2),
        "success": bool(episode.success),
        "return": round(float(episode.rewards.sum()), 2),
    }

"""Say what a dataset holds: the environment, its fields, how its episodes were made, and each of them.

Example: aerial-il info datasets/pick
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.configuration.keys import MISSING, key
from aerial_il.cli.tables import table

MADE_BY = ("task", "tier", "controller", "policy", "settings", "engine")


@dataclass
class Config:
    path: str = key(MISSING, "dataset, or one file", position=0)
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the description."""
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(config.path, failures=True)
    episodes = [_episode(e) for e in dataset]
    found = {"path": config.path, **_environment(dataset.spec), **_composition(episodes), "episodes": episodes}
    print(json.dumps(found, indent=2) if config.json else _as_text(found))


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


def _as_text(found: dict[str, Any]) -> str:
    episodes = found["episodes"]
    won, seconds = sum(e["success"] for e in episodes), sum(e["seconds"] for e in episodes)
    tiers = ", ".join(dict.fromkeys(e["tier"] for e in episodes))
    head = f"{found['path']}: {found['robot']} {found['task']} {tiers}. {found['instruction']}"
    action = f"Action {found['action']['level']}: {', '.join(found['action']['elements'])}"
    total = f"{len(episodes)} episodes, {won} successful, {seconds:.0f} s of flight"
    shown = [{key: e[key] for key in e if key not in MADE_BY} for e in episodes]
    notes = [_warning(found["repeated_seeds"])] if found["repeated_seeds"] else []
    return "\n\n".join([head, action, table(found["fields"]), total, table(found["made_by"]), *notes, table(shown)])


def _warning(seeds: Sequence[int]) -> str:
    named = ", ".join(map(str, seeds[:10])) + (", ..." if len(seeds) > 10 else "")
    return f"Warning: {len(seeds)} seeds were flown more than once, so these episodes start alike: {named}."

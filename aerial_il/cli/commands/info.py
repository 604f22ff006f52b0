"""Say what a dataset holds: the environment, its fields, and each episode.

Example: aerial-il info datasets/pick
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.keys import MISSING, key
from aerial_il.cli.tables import table


@dataclass
class Config:
    path: str = key(MISSING, "dataset, or one file", position=0)
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the description."""
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(config.path, failures=True)
    found = {"path": config.path, **_environment(dataset.spec), "episodes": [_episode(e) for e in dataset]}
    print(json.dumps(found, indent=2) if config.json else _as_text(found))


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
    return {
        "uid": episode.uid,
        "seed": episode.provenance.get("seed"),
        "steps": len(episode),
        "seconds": round(len(episode) * episode.spec.control_dt_s, 2),
        "success": bool(episode.success),
        "return": round(float(episode.rewards.sum()), 2),
    }


def _as_text(found: dict[str, Any]) -> str:
    episodes = found["episodes"]
    won, seconds = sum(e["success"] for e in episodes), sum(e["seconds"] for e in episodes)
    head = f"{found['path']}: {found['robot']} {found['task']} {found['tier']}. {found['instruction']}"
    action = f"Action {found['action']['level']}: {', '.join(found['action']['elements'])}"
    total = f"{len(episodes)} episodes, {won} successful, {seconds:.0f} s of flight"
    return "\n\n".join([head, action, table(found["fields"]), total, table(episodes)])

"""Show what there is: robots, tasks, cells, tiers, action levels, policies, algorithms.

A cell is a robot with a task that it can do.

Example: aerial-il list json=true
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.keys import key
from aerial_il.cli.tables import table


@dataclass
class Config:
    json: bool = key(False, "print one JSON object instead of tables (also: --json)")


def run(config: Config) -> None:
    """Print the catalogue."""
    found = catalogue()
    print(json.dumps(found, indent=2) if config.json else as_text(found))


def catalogue() -> dict[str, list[dict[str, Any]]]:
    """Return everything that is registered, as plain rows."""
    from aerial_il import algorithms, policies, robots
    from aerial_il.control.actions import ActionLevel
    from aerial_il.suite import tasks, tiers

    cells = tasks.cells()
    return {
        "robots": [_robot_row(robots.get(name), cells) for name in robots.names()],
        "tasks": [_task_row(tasks.get(name), cells) for name in tasks.names()],
        "cells": [{"robot": robot, "task": task} for robot, task in cells],
        "tiers": [_tier_row(tiers.get(name)) for name in tiers.names()],
        "action_levels": [{"name": level.label} for level in ActionLevel],
        "policies": [{"name": name} for name in policies.list_policies()],
        "algorithms": [{"name": name} for name in algorithms.list_algorithms()],
    }


def as_text(found: dict[str, list[dict[str, Any]]]) -> str:
    """Lay the catalogue out in tables."""
    rows = {title: entries for title, entries in found.items() if title != "cells"}
    return "\n\n".join(f"{title.replace('_', ' ').capitalize()}\n{table(entries)}" for title, entries in rows.items())


def _robot_row(robot: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    return {
        "name": robot.name,
        "actuation": robot.actuation,
        "rotors": robot.num_rotors,
        "joints": robot.num_joints,
        "mass_kg": round(float(robot.vehicle.mass), 2),
        "tasks": [task for name, task in cells if name == robot.name],
    }


def _task_row(task: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    return {
        "name": task.name,
        "grade": task.grade,
        "time_limit_s": task.time_limit_s,
        "robots": [robot for robot, name in cells if name == task.name],
        "instruction": task.instruction,
    }


def _tier_row(tier: Any) -> dict[str, Any]:
    return {"name": tier.name, "gusts_up_to_percent_of_weight": round(100 * tier.gust_limit, 1)}

"""Show what there is: robots, tasks, cells, tiers, sensors, action levels, controllers, policies, algorithms.

Tiers are shown with the components that they may be made of. A cell is a robot with a task that it can do; where it
cannot, the table of what is declined says why. The gallery shows all cells, with a film of an expert's flight each.

Example: aerial-il list json=true
Example: aerial-il list html=true
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.configuration.keys import key
from aerial_il.cli.tables import table
from aerial_il.core.errors import InvalidValueError

GALLERY = "runs/gallery.html"
HIDDEN = ("summary",)  # too long for a terminal's table


@dataclass
class Config:
    json: bool = key(False, "print one JSON object instead of tables (also: --json)")
    html: str | None = key(None, f"write a gallery page that opens offline: true for {GALLERY}, or its path")
    sheet: str | None = key(None, "with html: also one PNG with a picture of every robot and task")
    progress: bool = key(True, "show a progress bar while films are made")

    def __post_init__(self) -> None:
        self.html = {"true": GALLERY, "false": None}.get(str(self.html).lower(), self.html)
        if self.html and not self.html.endswith(".html"):
            raise InvalidValueError(f"html={self.html} names a page: it ends in .html, or is true for {GALLERY}.")
        if self.sheet and not (self.html and self.sheet.endswith(".png")):
            raise InvalidValueError(f"sheet={self.sheet} needs html=... too, and a path that ends in .png.")


def run(config: Config) -> None:
    """Print the catalogue, or write the gallery."""
    found = catalogue()
    if config.html:
        show(config, found)
    else:
        print(json.dumps(found, indent=2) if config.json else as_text(found))


def show(config: Config, found: dict[str, list[dict[str, Any]]]) -> None:
    """Write the page, and the sheet if it is wanted, and say where they are."""
    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.pages.gallery import write_gallery, write_sheet
    from aerial_il.workflows.parts.pilots import expert_flight

    assert config.html is not None
    if config.sheet:
        require_rendering(f"sheet={config.sheet}")
    problem = obstacle()
    note = f"No pictures: {problem}" if problem else ""
    if note:
        print(note)
    gallery = write_gallery(config.html, found, fly=expert_flight, note=note, progress=config.progress)
    print(f"Gallery: {gallery.path} ({gallery.path.stat().st_size / 1e6:.1f} MB)")
    if config.sheet:
        print(f"Sheet: {write_sheet(config.sheet, gallery)}")


def catalogue() -> dict[str, list[dict[str, Any]]]:
    """Return everything that is registered, as plain rows."""
    from aerial_il import algorithms, policies, robots
    from aerial_il.control import controllers
    from aerial_il.control.actions import ActionLevel
    from aerial_il.suite import sensors, tasks, tiers

    cells = tasks.cells()
    return {
        "robots": [_robot_row(robots.get(name), cells) for name in robots.names()],
        "tasks": [_task_row(tasks.get(name), cells) for name in tasks.names()],
        "cells": [{"robot": robot, "task": task} for robot, task in cells],
        "declined": [
            _declined_row(robot, task)
            for robot in robots.names()
            for task in tasks.names()
            if (robot, task) not in cells
        ],
        "tiers": [_tier_row(tiers.get(name)) for name in tiers.names()],
        "tier_components": [_component_row(name, tiers.standard(name)) for name in tiers.components()],
        "sensors": [_sensor_row(name) for name in sensors.names()],
        "action_levels": [{"name": level.label} for level in ActionLevel],
        "controllers": [{"name": name, "summary": controllers.get(name).summary} for name in controllers.names()],
        "policies": [{"name": name} for name in policies.names()],
        "algorithms": [{"name": name} for name in algorithms.names()],
    }


def as_text(found: dict[str, list[dict[str, Any]]]) -> str:
    """Lay the catalogue out in tables."""
    rows = {
        title: [{key: value for key, value in entry.items() if key not in HIDDEN} for entry in entries]
        for title, entries in found.items()
        if title != "cells"
    }
    return "\n\n".join(f"{title.replace('_', ' ').capitalize()}\n{table(entries)}" for title, entries in rows.items())


def _robot_row(robot: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    return {
        "name": robot.name,
        "summary": robot.summary,
        "actuation": robot.actuation,
        "rotors": robot.num_rotors,
        "joints": robot.num_joints,
        "mass_kg": round(float(robot.vehicle.mass), 2),
        "cameras": [camera.name for camera in robot.mounted_cameras],
        "tasks": [task for name, task in cells if name == robot.name],
    }


def _sensor_row(name: str) -> dict[str, Any]:
    from aerial_il import robots
    from aerial_il.suite import sensors

    shown = ((each, fields) for robot in robots.names() for each, _, fields in sensors.of(robots.get(robot)))
    found = next((fields for each, fields in shown if each == name), ())
    return {"name": name, "fields": [f"{f.name}: {f.meaning}{f' ({f.unit})' if f.unit else ''}" for f in found]}


def _task_row(task: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    return {
        "name": task.name,
        "grade": task.grade,
        "time_limit_s": task.time_limit_s,
        "robots": [robot for robot, name in cells if name == task.name],
        "instruction": task.instruction,
    }


def _declined_row(robot: str, task: str) -> dict[str, Any]:
    from aerial_il import robots
    from aerial_il.suite import tasks

    return {"robot": robot, "task": task, "reason": tasks.get(task).infeasibility(robots.get(robot))}


def _tier_row(tier: Any) -> dict[str, Any]:
    wind = tier.parts.get("wind")
    return {
        "name": tier.name,
        "components": list(tier.components),
        "gusts_percent_of_weight": round(100 * wind.share, 1) if wind else 0.0,
    }


def _component_row(name: str, strength: Any) -> dict[str, Any]:
    return {
        "name": name,
        "what": str(type(strength).__doc__).partition("\n")[0],
        "strength_when_added": [f"{key} {value:g}" for key, value in vars(strength).items()],
    }

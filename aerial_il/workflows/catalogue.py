"""What there is: robots, tasks, cells, tiers, sensors, levels, controllers, policies, algorithms; and their gallery."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError

GALLERY = "runs/gallery.html"
Catalogue = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True, kw_only=True)
class Gallery:
    """The page of all there is.

    Attributes:
        html: write a gallery page that opens offline: true for runs/gallery.html, or its path.
        sheet: with html: also one PNG with a picture of every robot and task.
        progress: show a progress bar while films are made.
    """

    html: str | None = None
    sheet: str | None = None
    progress: bool = True

    def __post_init__(self) -> None:
        if self.page and not self.page.endswith(".html"):
            raise InvalidValueError(f"html={self.page} names a page: it ends in .html, or is true for {GALLERY}.")
        if self.sheet and not (self.page and self.sheet.endswith(".png")):
            raise InvalidValueError(f"sheet={self.sheet} needs html=... too, and a path that ends in .png.")

    @property
    def page(self) -> str | None:
        """Where the page goes; None for no page."""
        return {"true": GALLERY, "false": None}.get(str(self.html).lower(), self.html)


@dataclass(frozen=True)
class Written:
    """The page, the sheet if one was wanted, and why there are no pictures."""

    page: Path
    sheet: Path | None
    note: str


def gallery(settings: Gallery, page: str) -> Written:
    """Write the page, and the sheet if it is wanted."""
    from aerial_il.core.rendering import require_rendering
    from aerial_il.presentation.films.scene_renderer import obstacle
    from aerial_il.presentation.pages.gallery import write_gallery, write_sheet
    from aerial_il.workflows.parts.pilots import expert_flight

    if settings.sheet:
        require_rendering(f"sheet={settings.sheet}")
    problem = obstacle()
    note = f"No pictures: {problem}" if problem else ""
    made = write_gallery(page, catalogue(), fly=expert_flight, note=note, progress=settings.progress)
    sheet = Path(write_sheet(settings.sheet, made)) if settings.sheet else None
    return Written(made.path, sheet, note)


def catalogue() -> Catalogue:
    """Return everything that is registered, as plain rows."""
    from aerial_il import algorithms, policies, robots
    from aerial_il.control.actions import ActionLevel
    from aerial_il.suite import tasks, tiers

    cells = tasks.cells()
    pairs = [(robot, task) for robot in robots.readable() for task in tasks.names() if (robot, task) not in cells]
    reasons = [tasks.get(task).infeasibility(robots.get(robot)) for robot, task in pairs]
    laws = {name: registry.get("controller", name) for name in registry.names("controller")}
    return {
        "robots": [_robot_row(robots.get(name), cells) for name in robots.readable()],
        "tasks": [_task_row(tasks.get(name), cells) for name in tasks.names()],
        "cells": [{"robot": robot, "task": task} for robot, task in cells],
        "declined": [{"robot": r, "task": t, "reason": why} for (r, t), why in zip(pairs, reasons, strict=True)],
        "tiers": [_tier_row(tiers.get(name)) for name in tiers.names()],
        "tier_components": [_component_row(name, tiers.standard(name)) for name in tiers.components()],
        "sensors": [_sensor_row(name) for name in registry.names("sensor")],
        "action_levels": [{"name": level.label} for level in ActionLevel],
        "controllers": [{"name": name, "summary": law.summary} for name, law in laws.items()],
        "policies": [{"name": name} for name in policies.names()],
        "algorithms": [{"name": name} for name in algorithms.names()],
    }


def _robot_row(robot: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    from aerial_il.robots.parts.camera import STANDARD

    return {
        "name": robot.name,
        "summary": robot.summary,
        "actuation": robot.actuation,
        "rotors": robot.num_rotors,
        "joints": robot.num_joints,
        "mass_kg": round(float(robot.vehicle.mass), 2),
        "cameras": list(STANDARD) if robot.cameras is None else [camera.name for camera in robot.cameras],
        "tasks": [task for name, task in cells if name == robot.name],
    }


def _sensor_row(name: str) -> dict[str, Any]:
    from aerial_il import robots
    from aerial_il.suite import sensors

    shown = ((each, fields) for robot in robots.readable() for each, _, fields in sensors.of(robots.get(robot)))
    known = next((fields for each, fields in shown if each == name), ())
    return {"name": name, "fields": [f"{f.name}: {f.meaning}{f' ({f.unit})' if f.unit else ''}" for f in known]}


def _task_row(task: Any, cells: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    return {
        "name": task.name,
        "grade": task.grade,
        "time_limit_s": task.time_limit_s,
        "robots": [robot for robot, name in cells if name == task.name],
        "instruction": task.instruction,
    }


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

"""A page that shows every robot and every task: what there is, what it looks like, how the experts fly it.

Everything is read from the registries. Films lie beside the page, in ``<page>_clips``, and are made only once.
"""

import logging
import os
import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.core.errors import AerialError
from aerial_il.core.files import write_atomic
from aerial_il.core.progress import Progress
from aerial_il.core.specs import ActionSpec
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.clips import FlightClips, make_clips
from aerial_il.presentation.films.overlay import font
from aerial_il.presentation.films.video import png
from aerial_il.presentation.pages.charts import tick_label
from aerial_il.presentation.pages.page import data_uri, words, write_page
from aerial_il.suite import tasks

Fly = Callable[[str, str], tuple[Episode, np.ndarray]]
Catalogue = Mapping[str, Sequence[Mapping[str, Any]]]
SHEET_COLUMNS, SHEET_PICTURE, SHEET_LABEL = 6, (150, 200), 26  # (height, width) of a picture, height of its name
SHEET_GROUND, SHEET_INKS = (255, 255, 255), {"robot": (43, 95, 174), "task": (24, 32, 38)}
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Card:
    """A robot or a task on the page.

    Attributes:
        name: registry name. kind: ``robot`` or ``task``. robot, task: the cell that its film shows.
        clips: its pictures, or None where none could be made. won: the flight succeeded. seed: of the flight.
        problem: why there are no pictures.
    """

    name: str
    kind: str
    robot: str
    task: str
    clips: FlightClips | None = None
    won: bool = True
    seed: int = 0
    problem: str = ""

    @property
    def picture(self) -> Path | None:
        """A robot is shown alone, a task at work."""
        return None if self.clips is None else self.clips.portrait if self.kind == "robot" else self.clips.poster


@dataclass(frozen=True)
class Gallery:
    """The page on disk and what is on it.

    Attributes:
        path: the page. cards: robots, then tasks. note: why there are no pictures, or empty.
    """

    path: Path
    cards: tuple[Card, ...]
    note: str = ""


def write_gallery(
    path: str | os.PathLike[str], catalogue: Catalogue, *, fly: Fly, note: str = "", progress: bool = True
) -> Gallery:
    """Write the page and make the films that are missing.

    Args:
        path: destination, an HTML file.
        catalogue: kind of thing -> rows of facts, as ``aerial-il list`` prints them.
        fly: robot and task -> a flight of the expert and its sub-task flags (T, K).
        note: why nothing can be rendered here; the page has no pictures then, and nothing is flown.
        progress: show a progress bar.
    """
    path = Path(path)
    folder = path.with_name(f"{path.stem}_clips")
    planned = cards()
    if not note:
        bar = Progress(planned, desc="gallery", unit="flight", disable=not progress)
        planned = [_filmed(card, fly, folder, bar) for card in bar]
    robot_rows = {row["name"]: row for row in catalogue["robots"]}
    task_rows = {row["name"]: row for row in catalogue["tasks"]}
    write_page(
        path,
        "gallery.html.j2",
        robots=[(card, robot_rows[card.name]) for card in planned if card.kind == "robot"],
        tasks=[(card, task_rows[card.name], tasks.get(card.name)) for card in planned if card.kind == "task"],
        matrix=matrix(),
        levels=action_levels(),
        tables={kind: catalogue[kind] for kind in ("tiers", "tier_components", "policies", "algorithms")},
        note=note,
        data_uri=data_uri,
    )
    return Gallery(path, tuple(planned), note)


def cards() -> list[Card]:
    """Choose the cell that each robot and each task is shown in, so that all robots and tasks are seen about equally.

    Who has the fewest cells to choose from chooses first. A task is shown by a robot that feels the air, if one can do
    it. A robot that can do nothing yet, and a task that no robot can do, are left out.
    """
    cells, robots_seen, tasks_seen, taken = tasks.cells(), Counter(), Counter(), set()
    names = [("robot", name) for name in robots.names()] + [("task", name) for name in tasks.names()]
    own = {(kind, name): [cell for cell in cells if cell[kind == "task"] == name] for kind, name in names}
    chosen: dict[tuple[str, str], Card] = {}
    for subject in sorted((each for each in names if own[each]), key=lambda each: len(own[each])):
        real = [cell for cell in own[subject] if robots.get(cell[0]).vehicle.drag.any()] or own[subject]
        best = min(real, key=lambda c: (c in taken, robots_seen[c[0]] + tasks_seen[c[1]], _ease(c[1])))
        taken.add(best)
        robots_seen[best[0]] += 1
        tasks_seen[best[1]] += 1
        chosen[subject] = Card(subject[1], subject[0], *best)
    return [chosen[subject] for subject in names if subject in chosen]


def matrix() -> list[tuple[str, list[tuple[str, str]]]]:
    """Return rows: a task with each robot and why it cannot do it, empty where it can."""
    return [
        (task, [(robot, tasks.get(task).infeasibility(robots.get(robot)) or "") for robot in robots.names()])
        for task in tasks.names()
    ]


def action_levels() -> list[tuple[str, str, list[str]]]:
    """Return rows: level, what is commanded on the robot with the most to command, and its size on every robot."""
    rows = []
    for level in ActionLevel:
        specs = [_spec(level, robot) for robot in robots.names()]
        fullest = max((spec for spec in specs if spec is not None), key=lambda spec: spec.size, default=None)
        sizes = ["–" if spec is None else str(spec.size) for spec in specs]
        rows.append((level.label, "; ".join(quantities(fullest)) if fullest else "", sizes))
    return rows


def quantities(spec: ActionSpec) -> list[str]:
    """Return the parts of an action with unit and bounds, e.g. ``ee (x, y, z) -3 to 3 m``."""
    stems = [label.rpartition("_")[0] or label for label in spec.labels]
    parts = []
    for stem, group in groupby(range(spec.size), key=lambda i: stems[i]):
        which = list(group)
        low, high = spec.low[which].min(), spec.high[which].max()
        count = f" x {len(which)}" if len(which) > 1 else ""
        parts.append(f"{words(stem)}{count}: {tick_label(low)} to {tick_label(high)} {spec.units[which[0]]}".strip())
    return parts


def write_sheet(path: str | os.PathLike[str], gallery: Gallery) -> Path:
    """Write one picture of all robots, their names in blue, and all tasks.

    Raises:
        AerialError: there are no pictures to put on it.
    """
    shown = [card for card in gallery.cards if card.picture is not None]
    if not shown:
        raise AerialError(f"{path}: no picture to put on the sheet. {gallery.note}")
    height, width = SHEET_PICTURE
    columns, rows = min(SHEET_COLUMNS, len(shown)), -(-len(shown) // SHEET_COLUMNS)
    sheet = Image.new("RGB", (columns * width, rows * (height + SHEET_LABEL)), SHEET_GROUND)
    draw = ImageDraw.Draw(sheet)
    for k, card in enumerate(shown):
        assert card.picture is not None
        x, y = k % SHEET_COLUMNS * width, k // SHEET_COLUMNS * (height + SHEET_LABEL)
        picture = Image.open(card.picture).resize((width - 4, height - 4), Image.Resampling.LANCZOS)
        sheet.paste(picture, (x + 2, y + 2))
        place, ink = (x + width // 2, y + height + SHEET_LABEL // 2 - 2), SHEET_INKS[card.kind]
        draw.text(place, card.name, font=font(14), fill=ink, anchor="mm")
    return write_atomic(Path(path), png(np.asarray(sheet)))


def copy_films(gallery: Gallery, folder: Path) -> list[Path]:
    """Copy each robot's and each task's picture and film to ``<kind>s/NAME.jpg`` and ``.mp4`` of ``folder``."""
    copied = []
    for card in gallery.cards:
        if card.clips is not None and card.picture is not None:
            place = folder / f"{card.kind}s"
            place.mkdir(parents=True, exist_ok=True)
            for file, suffix in ((card.picture, "jpg"), (card.clips.film, "mp4")):
                copied.append(Path(shutil.copyfile(file, place / f"{card.name}.{suffix}")))
    return copied


def _filmed(card: Card, fly: Fly, folder: Path, bar: Any) -> Card:
    bar.set_postfix_str(f"{card.robot} {card.task}", refresh=False)
    try:
        episode, flags = fly(card.robot, card.task)
    except AerialError as error:
        log.warning("%s %s: no film. %s", card.robot, card.task, error)
        return Card(card.name, card.kind, card.robot, card.task, problem=str(error))
    clips = make_clips(episode, flags, folder)
    return Card(card.name, card.kind, card.robot, card.task, clips, bool(episode.success), episode.seed)


def _ease(task: str) -> int:
    """The harder a task, the more there is to see: hard ones come first."""
    return ("hard", "medium", "easy").index(tasks.get(task).grade)


def _spec(level: ActionLevel, robot: str) -> ActionSpec | None:
    try:
        return action_spec(level, robots.get(robot).vehicle)
    except AerialError:
        return None

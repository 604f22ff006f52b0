"""A page per task: what success means, what is observed, how the expert does it, which robots can."""

from __future__ import annotations

import inspect
import os
from collections.abc import Sequence
from pathlib import Path

from aerial_il import experts, robots
from aerial_il.core.files import write_atomic
from aerial_il.suite import tasks
from aerial_il.suite.tasks.task import Task

NOTE = """\
Written by `aerial-il docs` from the task's own definition. Every episode of (robot, task, tier, seed) is the same bit
for bit. Besides the fields below a policy sees the robot's own state; cameras are `scene`, `wrist` and `base`. The
dense reward lies in [0, 1], the sparse one is 1 while the success condition has held for its dwell. How often the
experts succeed stands in `experiments/benchmarks.md`."""

EXACTNESS = """\
In `calm` and `breeze` all poses and forces are exact, the robot's own as well, which they are on no robot. In `gusts`,
`hard` and every tier with `estimation` the robot's pose is the one that its controller estimates, and what it sees and
feels comes with bias, noise and delay; see [the tiers](../tiers.md#estimation)."""


def write_pages(folder: str | os.PathLike[str]) -> list[Path]:
    """Write ``tasks/NAME.md`` of every task, and ``tasks/README.md``, into ``folder``."""
    place = Path(folder) / "tasks"
    place.mkdir(parents=True, exist_ok=True)
    found = [tasks.get(name) for name in tasks.names()]
    written = [write_atomic(place / f"{task.name}.md", page(task)) for task in found]
    return [*written, write_atomic(place / "README.md", overview(found))]


def overview(found: list[Task]) -> str:
    """Return the table of all tasks."""
    rows = [(f"[{t.name}]({t.name}.md)", t.grade, t.instruction, f"{t.time_limit_s:g}", len(_able(t))) for t in found]
    return f"# Tasks\n\n{_table(('task', 'grade', 'instruction', 'time limit (s)', 'robots'), rows)}\n\n{NOTE}\n"


def page(task: Task) -> str:
    """Return a task's page."""
    fields = [(f"`{f.name}`", f"{f.size}", f.unit or "–", ", ".join(f.labels)) for f in task.fields()]
    refused = [(name, task.infeasibility(robots.get(name))) for name in robots.names()]
    parts = [
        f"# {task.name}",
        f"> {task.instruction}",
        f"[![{task.name}]({task.name}.jpg)]({task.name}.mp4)\n\n*The film: an expert flies it in calm air.*",
        _text_of(type(task)),
        _table(("", ""), _facts(task)),
        "## Observed of the task",
        _table(("field", "numbers", "unit", "elements"), fields) if fields else "Nothing beside the robot's state.",
        "## What no real robot has",
        _privileges(task),
        "## Expert",
        _expert(task),
        "## Robots",
        ", ".join(f"`{name}`" for name in _able(task)) or "None yet.",
        "\n".join(f"- not `{name}`: {reason}" for name, reason in refused if reason),
        NOTE,
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _facts(task: Task) -> list[tuple[str, str]]:
    return [
        ("grade", task.grade),
        ("time limit", f"{task.time_limit_s:g} s"),
        ("success must hold for", f"{task.dwell_s:g} s"),
        ("sub-tasks", ", ".join(f"`{name}`" for name in task.subtasks) or "none"),
        ("force sensors", ", ".join(f"`{name}`" for name in task.force_sensors) or "none"),
    ]


def _privileges(task: Task) -> str:
    """Which fields a robot could not measure, and which are exact for a reason."""
    rows = [(f"`{name}`", reason) for name, reason in task.privileged]
    commanded = ", ".join(f"`{name}`" for name in task.commanded)
    parts = [
        _table(("field", "why"), rows) if rows else "Nothing in kind: a robot could estimate every field.",
        f"Commanded by the user rather than seen, and exact in every tier: {commanded}." if commanded else "",
        EXACTNESS,
    ]
    return "\n\n".join(part for part in parts if part)


def _expert(task: Task) -> str:
    """Describe the expert's way of doing it, and name its phases."""
    able = _able(task)
    if not able:
        return "None yet."
    expert = experts.make(able[0], task.name)
    phases = ", ".join(f"`{name}`" for name in expert.phase_names)
    return f"{_text_of(type(expert))}\n\nPhases: {phases}."


def _able(task: Task) -> list[str]:
    return [robot for robot, name in tasks.cells() if name == task.name]


def _text_of(thing: type) -> str:
    """A class's docstring as Markdown."""
    return (inspect.getdoc(thing) or "").replace("``", "`")


def _table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    head = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    return "\n".join([*head, *(f"| {' | '.join(map(str, row))} |" for row in rows)])

"""Pages of actions and observations, one per robot, from the specifications that environments and recordings carry."""

from collections.abc import Sequence

from aerial_il import robots
from aerial_il.control.actions import ActionLevel, action_spec, levels_of
from aerial_il.core.specs import ActionSpec, Field
from aerial_il.presentation.markdown import table
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks
from aerial_il.suite.sensors import robot_fields

INTRODUCTION = """\
# Spaces

Every element of every action, with its unit and bounds, and every field of the observations, robot by robot: the
content of `env.spec`, which each recording and each policy also stores. [Actions and observations](../actions.md)
explains the levels and the frames."""


def pages() -> dict[str, str]:
    """Return path on the site -> text: one page for each robot, and a table of sizes."""
    every = {name: robots.get(name) for name in robots.names()}
    levels = [level.label for level in ActionLevel]
    rows = [(f"[{name}]({name}.md)", *_sizes(robot)) for name, robot in every.items()]
    index = f"{INTRODUCTION}\n\n{table(('robot', 'observation', *map(_code, levels)), rows)}\n"
    return {"spaces/index.md": index, **{f"spaces/{name}.md": page(robot) for name, robot in every.items()}}


def page(robot: Robot) -> str:
    """Return a robot's actions and observations."""
    parts = [f"# Spaces of {robot.name}", f"{robot.summary} [Its figures](../robots/{robot.name}.md)."]
    parts += ["## Observation", _observation(robot_fields(robot)), _task_note(robot), "## Actions"]
    for level in levels_of(robot.vehicle):
        spec = action_spec(level, robot.vehicle)
        parts += [f"### {level.label}", _bounds(spec)]
    return "\n\n".join(parts) + "\n"


def _observation(fields: Sequence[Field]) -> str:
    rows = [
        (_code(f.name), str(f.shape), f.unit or "–", f.frame or "–", f.meaning, f.noise, ", ".join(f.labels))
        for f in fields
    ]
    return table(("field", "shape", "unit", "frame", "what", "noise", "elements"), rows)


def _task_note(robot: Robot) -> str:
    able = [task for name, task in tasks.cells() if name == robot.name]
    links = ", ".join(f"[{task}](../tasks/{task}.md)" for task in able)
    return f"With it come the fields of the task: {links}. Images: `cameras=[wrist,base,scene]`, (H, W, 3) `uint8`."


def _bounds(spec: ActionSpec) -> str:
    rows = [
        (str(i), _code(label), unit if unit not in ("", "1") else "–", f"{low:.4g}", f"{high:.4g}")
        for i, (label, unit, low, high) in enumerate(zip(spec.labels, spec.units, spec.low, spec.high, strict=True))
    ]
    return table(("", "element", "unit", "from", "to"), rows)


def _sizes(robot: Robot) -> list[str]:
    able = {level: action_spec(level, robot.vehicle).size for level in levels_of(robot.vehicle)}
    seen = sum(field.size for field in robot_fields(robot))
    return [str(seen), *(str(able.get(level, "–")) for level in ActionLevel)]


def _code(text: str) -> str:
    return f"`{text}`"

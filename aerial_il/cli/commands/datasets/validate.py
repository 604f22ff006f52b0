"""Read every recording in full and say which cannot be trusted, and why; status 2 if there is one.

Checks: checksums, digest and index; schema, shapes and types; finite values and bounds; times, sequence and end.

Example: aerial-il validate datasets/pick
Example: aerial-il validate datasets/pick replay=true
"""

from __future__ import annotations

from aerial_il.core.errors import DemoError
from aerial_il.workflows.spelling import command_line
from aerial_il.workflows.validate import Validate, validate

SETTINGS, BARE = Validate, ("path",)


def run(settings: Validate) -> None:
    """Print the problems, or that there are none."""
    checked = validate(settings)
    for problem in checked.problems:
        print(problem)
    if checked.problems:
        hint = f"Set them aside and save what can be saved: {command_line(['recover', f'path={settings.path}'])}"
        problem = f"{len(checked.problems)} problems in {checked.episodes} episodes."
        raise DemoError(settings.path, problem, hint=hint)
    if again := checked.replayed:
        print(f"{settings.path}: {again.episodes} episodes, {again.steps} steps flown again, every bit equal.")
    print(f"{settings.path}: {checked.episodes} episodes, all sound.")

"""Read every episode in full, in any format, and say which cannot be used, and why; status 2 if there is one.

Checks: checksums, digest and index; schema, shapes and types; finite values and bounds; times, sequence and end.

Example: aerial-il validate datasets/pick
Example: aerial-il validate datasets/pick replay=true
"""

from aerial_il.core.errors import DemoError
from aerial_il.workflows.spelling import command_line
from aerial_il.workflows.validate import Validate, validate

SETTINGS, BARE = Validate, ("path",)


def run(settings: Validate) -> None:
    """Print the problems, or that there are none."""
    checked = validate(settings)
    for line in (*checked.problems, *checked.notes):
        print(line)
    if checked.problems:
        recover = command_line(["recover", f"path={settings.path}"])
        hint = f"Training leaves them out. Of recordings, set them aside and save what can be saved: {recover}"
        problem = f"{len(checked.problems)} problems in {checked.episodes} episodes."
        raise DemoError(settings.path, problem, hint=hint)
    if again := checked.replayed:
        print(f"{settings.path}: {again.episodes} episodes, {again.steps} steps flown again, every bit equal.")
    print(f"{settings.path}: {checked.episodes} episodes, {'all usable' if checked.notes else 'all sound'}.")

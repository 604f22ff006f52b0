"""Write a working start for something of your own: a task, a robot, a disturbance, a policy, an algorithm, ….

The registries find it by its name: list, help, completion and the contract tests include it at once. docs/adding.md and
docs/writing_a_task.md explain each line.

Example: aerial-il new task stack_cubes
Example: aerial-il new policy my_network
"""

from aerial_il.workflows.new import New, new
from aerial_il.workflows.spelling import command_line

SETTINGS, BARE = New, ("kind", "name")


def run(settings: New) -> None:
    """Write the files, and say what comes next."""
    started = new(settings)
    for file in started.files:
        print(f"Written: {file}")
    print(f"Explained in: {started.page}")
    print(f"Next: {command_line(started.words)}")

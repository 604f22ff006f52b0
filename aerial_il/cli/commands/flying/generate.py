"""Make many demonstrations out of few, flown by an expert or by hand; killed at any moment, the same command continues.

A source is cut where it deals with a thing: grasps it, brings it somewhere, moves it on its hinge. There the tool's
path is moved to where the thing is in a new episode, joined by straight ways, and flown. It works for own tasks, too.

Example: aerial-il generate dataset=datasets/by_hand episodes=400 out=datasets/generated
Example: aerial-il generate dataset=datasets/pick sources=1 tier=gusts episodes=1000 out=datasets/pick_gusts
Example: aerial-il generate dataset=datasets/pick robot=ua_quad_arm4 episodes=1000 out=datasets/pick_quad
Example: aerial-il generate dataset=datasets/pick episodes=20000 seed=1000000 launcher=processes out=datasets/large
"""

from aerial_il.workflows.generate import Generate, generate, shards
from aerial_il.workflows.spelling import command_line, path

SETTINGS, OUTPUT = Generate, "out"
__all__ = ["OUTPUT", "SETTINGS", "run", "shards"]


def run(settings: Generate) -> None:
    """Generate, and say what comes next."""
    from aerial_il.data.folder import DatasetFolder

    generate(settings)
    if DatasetFolder(settings.out).files():
        print(f"Next: {command_line(['train', path('dataset', settings.out), 'run=runs/generated'])}")

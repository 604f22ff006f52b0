"""Correct what is said of episodes: success, operator, instruction or a tag of your own.

The steps stay as they are, bit for bit; the provenance keeps what was said before. aerial-il undo takes it back.
where= is that of aerial-il filter. Interrupted, the same command goes on.

Example: aerial-il relabel datasets/pick where="seed in [12, 31]" success=false
Example: aerial-il relabel datasets/pick where="operator == 'anna'" operator=ana
Example: aerial-il relabel datasets/pick where="return < 50" tag=slow
"""

from aerial_il.workflows.edit import Relabel, relabel
from aerial_il.workflows.spelling import command_line

SETTINGS, BARE = Relabel, ("dataset",)


def run(settings: Relabel) -> None:
    """Relabel, and say how to take it back."""
    edit = relabel(settings)
    back = command_line(["undo", settings.dataset])
    print(f"{settings.dataset}: {len(edit.episodes)} episodes relabelled. Take it back: {back}")

"""Move the episodes for which a condition holds to the trash of their dataset; aerial-il undo brings them back.

where= is that of aerial-il filter; aerial-il info DATASET where=... shows which ones these are. Interrupted, the same
command goes on. Episodes in the trash/ of a dataset count nowhere; remove the folder to free the disk.

Example: aerial-il delete datasets/pick where="not success and steps < 20"
"""

from aerial_il.workflows.edit import Delete, delete
from aerial_il.workflows.spelling import command_line

SETTINGS, BARE = Delete, ("dataset",)


def run(settings: Delete) -> None:
    """Delete, and say how to take it back."""
    edit = delete(settings)
    back = command_line(["undo", settings.dataset])
    print(f"{settings.dataset}: {len(edit.episodes)} episodes moved to {settings.dataset}/trash. Take it back: {back}")

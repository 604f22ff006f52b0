"""Take the last delete, relabel or segment of a dataset back: the very files return; again, the one before it.

Example: aerial-il undo datasets/pick
"""

from aerial_il.workflows.edit import Undo, undo

SETTINGS, BARE = Undo, ("dataset",)


def run(settings: Undo) -> None:
    """Take it back, and say what it was."""
    edit = undo(settings)
    print(f"{settings.dataset}: {edit.count} episodes are back that were {edit.what} (where={edit.where}).")

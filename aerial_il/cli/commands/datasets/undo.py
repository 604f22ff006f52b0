"""Take the last delete or relabel of a dataset back: the very files return; again, the one before it.

Example: aerial-il undo datasets/pick
"""

from __future__ import annotations

from aerial_il.workflows.edit import Undo, undo

SETTINGS, BARE = Undo, ("dataset",)


def run(settings: Undo) -> None:
    """Take it back, and say what it was."""
    edit = undo(settings)
    what = "deleted" if edit.labels is None else "relabelled"
    print(f"{settings.dataset}: {len(edit.episodes)} episodes are back that were {what} (where={edit.where}).")

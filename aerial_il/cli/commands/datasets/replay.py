"""Fly recordings again from their recorded actions and require every state to be the same, bit for bit.

Example: aerial-il replay datasets/pick
Example: aerial-il replay datasets/pick/demos/EPISODE.mcap starts=[0,100,200]
"""

from aerial_il.workflows.replay import Replay, replay

SETTINGS, BARE = Replay, ("path",)


def run(settings: Replay) -> None:
    """Replay, and say how many steps were compared."""
    compared = replay(settings)
    print(f"{settings.path}: {compared.episodes} episodes, {compared.steps} steps flown again, every bit equal.")

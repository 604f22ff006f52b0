"""Put datasets of one environment together; their files are shared where the disk allows.

Sets of different robots, tasks, rates, action levels or observations are refused, naming the key that differs; those
of another tier, flight law, pilot, settings or engine, too, unless mix=true. An episode that is in several is taken
once. Other formats than ours are recorded anew.

Example: aerial-il merge datasets=[datasets/monday,datasets/tuesday] out=datasets/week
Example: aerial-il merge datasets/monday datasets/tuesday out=datasets/week mix=true
"""

from aerial_il.workflows.derive import Merge, merge

SETTINGS, BARE = Merge, ("datasets",)


def run(settings: Merge) -> None:
    """Merge, and say what came of it."""
    made = merge(settings)
    twice = f" ({made.of - made.episodes} were in several)" if made.of > made.episodes else ""
    print(f"{made.path}: {made.episodes} episodes of {len(settings.datasets)} datasets{twice}.")

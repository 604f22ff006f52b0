"""Split a dataset by episode into parts that are alike, each a dataset: the same for the same seed.

Each part gets its share of the successes and failures, and of each tag and operator. The files are shared where the
disk allows.

Example: aerial-il split datasets/pick out=datasets/pick_split
Example: aerial-il split datasets/pick parts=[train=0.7,validation=0.2,test=0.1] out=datasets/pick_split seed=3
"""

from aerial_il.workflows.derive import Split, split

SETTINGS, BARE = Split, ("dataset",)


def run(settings: Split) -> None:
    """Split, and say what each part holds."""
    for made in split(settings):
        print(f"{made.path}: {made.episodes} of {made.of} episodes.")

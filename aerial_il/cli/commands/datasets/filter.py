"""Make a dataset of the episodes for which a condition holds; the files are shared where the disk allows.

where= compares columns with constants: uid, task, tier, controller, policy, settings, engine, operator, instruction,
tag, seed, steps, seconds, success, failure (crash, dropped, timeout, other), phase (in which it ended), return; and
whatever the provenance says, such as mujoco or settings['noise']. It knows and, or, not, in and arithmetic.

Example: aerial-il filter datasets/pick where="success and seconds < 12 and operator == 'ana'" out=datasets/quick
Example: aerial-il filter datasets/pick where="settings['noise'] > 0.1 or phase in ['grasp', 'lift']" out=datasets/hard
"""

from aerial_il.workflows.derive import Filter, filter

SETTINGS, BARE = Filter, ("dataset",)


def run(settings: Filter) -> None:
    """Filter, and say how many episodes are left."""
    made = filter(settings)
    print(f"{made.path}: {made.episodes} of {made.of} episodes.")

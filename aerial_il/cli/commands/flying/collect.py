"""Let the expert fly and record every flight; killed at any moment, the same command continues.

Each seed is one episode. Successes go to demos/, the others, labelled so, to failures/.

launcher=processes, slurm or ray divides the seeds among jobs that record into the same folder, on one machine or many.
The dataset is the same, byte for byte, however many there are.

Example: aerial-il collect robot=fa_hexa_arm4 task=reach episodes=100 out=datasets/reach
Example: aerial-il collect task=pick_place episodes=50 cameras=[wrist,scene] lerobot=true out=datasets/pick_seen
Example: aerial-il collect robot=quad task=hover expert=my_pilot:make episodes=20 out=datasets/mine
Example: aerial-il collect task=pick_place episodes=100000 seed=1000000 launcher=processes out=datasets/large
Example: aerial-il collect env=gymnasium:AdroitHandDoor-v1 policy=dapg_policies.npz success=success:25 out=datasets/door
"""

from aerial_il.workflows.collect import Collect, collect, shards
from aerial_il.workflows.spelling import command_line, path

SETTINGS, OUTPUT = Collect, "out"
__all__ = ["OUTPUT", "SETTINGS", "run", "shards"]


def run(settings: Collect) -> None:
    """Record, and say what comes next."""
    from aerial_il.data.folder import DatasetFolder

    collect(settings)
    if settings.lerobot:
        print(f"LeRobot dataset: {settings.out}/derived/lerobot")
    name = settings.task if settings.env is None else settings.env.partition(":")[2]
    if DatasetFolder(settings.out).files():
        print(f"Next: {command_line(['train', path('dataset', settings.out), f'run=runs/{name}'])}")

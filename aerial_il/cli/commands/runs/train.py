"""Train a policy on demonstrations; killed at any moment, the same command continues.

The run folder holds config.yaml, metrics.jsonl, tensorboard/, checkpoints/ and at the end policy/; cloning with
rollouts on the way also best/, the policy that flew best in them, which is never the one that is reported. Trackers
beside TensorBoard are extras: tracker=[tensorboard,wandb], after pip install 'aerial-il[wandb]'.

Several values are a sweep, e.g. seed=0,1,2 --multirun: one run per value in RUN/seed=0 and so on; `aerial-il report
RUN` shows them all together.

Demonstrations that a person flew are relabelled and seen from the tool, which a line says: see docs/take_over.md.
dataset.by_hand=false learns from them as recorded, true takes any recording for one by hand.

The keys of a policy and an algorithm: aerial-il train policy=act algorithm=dagger --help. A policy class is trained
anew; to go on from a trained one, algorithm=bc_ppo algorithm.prior=RUN.

from=RUN trains anew, with the settings and the dataset of that run, in another folder; what else is typed goes before
them. A policy or an algorithm that is named, the same one too, comes with its own defaults.

Who flies while it learns does so in the environment of the demonstrations. Learners from reward (sac, ppo, td3) need
none, only env=..., or robot=... and task=...; said beside a dataset, these are what it must have been recorded with.

Example: aerial-il train dataset=datasets/pick policy=mlp algorithm=bc run=runs/pick_bc
Example: aerial-il train dataset=datasets/pick run=runs/pick_bc evaluate_every=1000 evaluate_episodes=50
Example: aerial-il train from=runs/pick_bc algorithm.lr=1e-4 run=runs/pick_slow
Example: aerial-il train algorithm=dagger dataset=datasets/pick run=runs/pick_dagger
Example: aerial-il train algorithm=dagger expert=my_pilot:make dataset=datasets/mine run=runs/asked
Example: aerial-il train algorithm=hg_dagger expert=human dataset=datasets/by_hand run=runs/rescued
Example: aerial-il train algorithm=sac policy=squashed_gaussian env=gymnasium:Hopper-v5 run=runs/hopper
Example: aerial-il train algorithm=ppo policy=squashed_gaussian robot=z1 task=reach horizon=200 run=runs/z1_ppo
"""

from aerial_il.workflows.spelling import command_line, path
from aerial_il.workflows.train import Train, train

SETTINGS, OUTPUT = Train, "run"


def run(settings: Train) -> None:
    """Train, and say what comes next."""
    train(settings)
    print(f"Policy: {settings.run}/policy")
    print(f"Next: {command_line(['evaluate', path('policy', settings.run), f'out={settings.run}/evaluation'])}")

"""Train an expert by proximal policy optimisation, for a task where the study's soft actor-critic takes too long.

    python experiments/gail/expert.py --task Walker2d-v5 --steps 2000000

It resumes when it was interrupted, prints what the expert is worth on 20 episodes, and keeps it, with its settings and
where it comes from, in ``experiments/gail/experts/TASK``, where ``aerial-il bench gail`` finds it.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

import numpy as np

import aerial_il
from aerial_il.algorithms.ppo import PPO
from aerial_il.core.composition import build
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.squashed_gaussian import SquashedGaussian

KEPT = Path(__file__).parent / "experts"
FILES = ("config.yaml", "provenance.json", "policy")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--task", default="Walker2d-v5")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--runs", default="runs/experts")
    options = parser.parse_args()
    run = Path(options.runs) / options.task
    cadence = {"log_every": 40_960, "checkpoint_every": 204_800, "keep_checkpoints": 1}
    algorithm = build(PPO, {"steps": options.steps, "rollout": {"steps": 4096}, "cadence": cadence})
    network = SquashedGaussian(hidden=(64, 64), activation="tanh", spread="free", log_std=-0.5)
    env = aerial_il.load_gymnasium(options.task, num_envs=16, processes=options.processes)
    expert = algorithm.train(None, network, env=env, run=run)
    judged = evaluate(env, expert, range(5000, 5020), policy_name="expert")
    env.close()
    returns = [episode.return_ for episode in judged.episodes]
    print(f"{options.task}: return {np.mean(returns):.0f} ({min(returns):.0f} to {max(returns):.0f}); run in {run}")
    for name in FILES:
        keep(run / name, KEPT / options.task / name)


def keep(source: Path, kept: Path) -> None:
    """Copy a file or a folder over what was kept before."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, kept, dirs_exist_ok=True)
    else:
        shutil.copy2(source, kept)


if __name__ == "__main__":
    main()

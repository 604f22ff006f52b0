"""Measure the ``imitation`` library's GAIL on the demonstrations that ours learned from, over as many steps.

It needs other versions than ours do, so it runs in a virtual environment of its own, which this script makes:

    python experiments/gail/peer.py --study runs/benchmarks/gail --task Hopper-v5 --steps 1000000 --seeds 3

The recordings are exported by the python that starts the script; it then calls itself with the other one's. Each
result, ``experiments/gail/peer/TASK.json``, appears in the table of ``aerial-il bench gail``. What is done is not done
again.
The peer flies the ``-v4`` of the task: its Gymnasium knows no other. Observations and dynamics are those of ``-v5``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = ["imitation==1.0.1", "gymnasium[mujoco]==0.29.1", "mujoco>=3.1,<3.2", "numpy<2", "setuptools<81"]
EPISODES, EVALUATION_SEED = 100, 10_000


def main() -> None:
    options = parsed()
    if options.inside:
        measure(options)
        return
    demos = export(Path(options.study), options.task, Path(options.venv).parent)
    python = environment(Path(options.venv))
    command = [str(python), "-E", __file__, "--inside", "--task", options.task, "--demos", str(demos)]
    numbers = {"--steps": options.steps, "--seeds": options.seeds, "--envs": options.envs}
    command += ["--parallel"] if options.parallel else []
    blind = {**os.environ, "MUJOCO_GL": "disabled"}  # torch and an EGL context do not get on in that environment
    subprocess.run([*command, *(str(word) for pair in numbers.items() for word in pair)], check=True, env=blind)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--study", default="runs/benchmarks/gail", help="folder of our study, with its datasets")
    parser.add_argument("--task", default="Hopper-v5")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--parallel", action="store_true", help="each of its environments in a process of its own")
    parser.add_argument("--venv", default="runs/peer/venv")
    parser.add_argument("--demos")
    parser.add_argument("--inside", action="store_true")
    return parser.parse_args()


def export(study: Path, task: str, folder: Path) -> Path:
    """Write the demonstrations as plain arrays and return the file."""
    import numpy as np

    import aerial_il

    wanted = json.loads((study / "settings.json").read_text())["trajectories"]
    episodes = [e for e in aerial_il.open_dataset(str(study / "datasets" / task)) if e.success][:wanted]
    names = episodes[0].spec.observation.names
    arrays = {f"obs_{i}": e.flat_obs(names).astype(np.float64) for i, e in enumerate(episodes)}
    arrays |= {f"acts_{i}": e.executed_actions.astype(np.float32) for i, e in enumerate(episodes)}
    ends = np.array([bool(e.terminated[-1]) for e in episodes])
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / f"{task}.npz", ends=ends, **arrays)
    return folder / f"{task}.npz"


def environment(venv: Path) -> Path:
    """Make the peer's virtual environment where it is missing and return its python."""
    python = venv / "bin" / "python"
    if not (venv / "done").exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(venv)], check=True)
        own = Path(".tools/bin/uv")  # what `make setup` installs with: minutes faster than pip at finding versions
        fast, slow = [own, "pip", "install", "--python", python], [python, "-m", "pip", "install"]
        subprocess.run([*(fast if own.exists() else slow), "--quiet", *PACKAGES], check=True)
        (venv / "done").touch()
    return python


def measure(options: argparse.Namespace) -> None:
    """Train and judge each seed that is missing, then sum up."""
    folder = Path(options.demos).parent / options.task
    folder.mkdir(parents=True, exist_ok=True)
    worlds = f"{options.envs} environments, each in a process" if options.parallel else f"{options.envs} environments"
    place = f"{options.steps}-{worlds.replace(', ', '-').replace(' ', '_')}"
    done = [one_seed(options, seed, folder / f"{place}-{seed}.json") for seed in range(options.seeds)]
    found = {
        "task": options.task,
        "library": f"imitation 1.0.1 GAIL ({worlds})",
        "seeds": len(done),
        "steps": options.steps,
        "returns": [value for one in done for value in one["returns"]],
        "train_s": sum(one["train_s"] for one in done) / len(done),
    }
    (HERE / "peer").mkdir(exist_ok=True)
    (HERE / "peer" / f"{options.task}.json").write_text(json.dumps(found, indent=1) + "\n")


def one_seed(options: argparse.Namespace, seed: int, kept: Path) -> dict:
    if kept.exists():
        return json.loads(kept.read_text())
    import gymnasium
    import numpy as np
    import torch
    from imitation.algorithms.adversarial.gail import GAIL
    from imitation.data.types import Trajectory
    from imitation.data.wrappers import RolloutInfoWrapper
    from imitation.rewards.reward_nets import BasicRewardNet
    from imitation.util import logger
    from imitation.util.networks import RunningNorm
    from imitation.util.util import make_vec_env
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    name, data = options.task.replace("-v5", "-v4"), np.load(options.demos)
    demos = [
        Trajectory(data[f"obs_{i}"], data[f"acts_{i}"], None, terminal=bool(end)) for i, end in enumerate(data["ends"])
    ]
    rng = np.random.default_rng(seed)
    venv = make_vec_env(
        name, rng=rng, n_envs=options.envs, parallel=options.parallel,
        post_wrappers=[lambda env, _: RolloutInfoWrapper(env)],
    )  # fmt: skip
    # Learner and discriminator as in the library's own GAIL example, with its normalisation.
    learner = PPO(
        "MlpPolicy", venv, batch_size=64, ent_coef=0.0, learning_rate=4e-4, gamma=0.95, n_epochs=5, seed=seed,
        n_steps=2048 // options.envs, device="cpu",
    )  # fmt: skip
    reward = BasicRewardNet(venv.observation_space, venv.action_space, normalize_input_layer=RunningNorm)
    trainer = GAIL(
        demonstrations=demos, demo_batch_size=1024, gen_replay_buffer_capacity=512, n_disc_updates_per_round=8,
        venv=venv, gen_algo=learner, reward_net=reward, allow_variable_horizon=True,
        custom_logger=logger.configure(kept.parent / f"log-{seed}", format_strs=["csv"]),
    )  # fmt: skip
    started = time.perf_counter()
    trainer.train(options.steps)
    train_s = time.perf_counter() - started
    venv.close()
    env, returns = gymnasium.make(name), []
    for episode in range(EPISODES):
        obs, _ = env.reset(seed=EVALUATION_SEED + episode)
        total, over = 0.0, False
        while not over:
            obs, paid, ended, cut, _ = env.step(learner.predict(obs, deterministic=True)[0])
            total, over = total + float(paid), ended or cut
        returns.append(total)
    found = {"returns": returns, "train_s": train_s}
    kept.write_text(json.dumps(found))
    return found


if __name__ == "__main__":
    main()

"""Measure the ``imitation`` library's GAIL on the demonstrations that ours learned from, over as many steps.

It needs other versions than ours do, so it runs in a virtual environment of its own, which this script makes:

    python experiments/gail/peer.py --settings published --envs 8 --steps 500000 --seeds 3
    python experiments/gail/peer.py --settings published --envs 8 --parallel --steps 500000 --seeds 3

The demonstrations, another draw for each training, are those of ``aerial-il bench gail``: the python that starts the
script takes them from the study's record, or has them flown, and exports them; then it calls itself with the other's.
Each result, ``experiments/gail/peer/TASK-SETTINGS-ENVS.json``, appears in the table of ``aerial-il bench gail``. What
is done is not done again. The peer flies the ``-v4`` of the task: its Gymnasium knows no other. Observations and
dynamics are those of ``-v5``.

Settings. ``published``: what the library's authors tuned for GAIL on Hopper, ``gail_seals_hopper_best_hp_eval.json`` in
its folder ``benchmarking`` (there for ten million steps of an environment of fixed length). ``example``: those of the
GAIL example in its documentation.
"""

# pyright: reportMissingImports=false
# What it imports of the other library is in the other environment.
from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LIBRARY = "imitation 1.0.1 GAIL"
PACKAGES = ["imitation==1.0.1", "gymnasium[mujoco]==0.29.1", "mujoco>=3.1,<3.2", "numpy<2", "setuptools<81"]
EPISODES, EVALUATION_SEED = 100, 20_000
ROLLOUT = {"published": 4096, "example": 2048}  # steps of all worlds together
LEARNER: dict[str, dict[str, Any]] = {
    "published": {
        "batch_size": 512, "clip_range": 0.1, "ent_coef": 0.001255299425412744, "gae_lambda": 0.98, "gamma": 0.995,
        "learning_rate": 4.3984856156897565e-5, "max_grad_norm": 0.9, "n_epochs": 20, "vf_coef": 0.20315938606555833,
    },
    "example": {"batch_size": 64, "ent_coef": 0.0, "gamma": 0.95, "learning_rate": 4e-4, "n_epochs": 5},
}  # fmt: skip
TRAINER: dict[str, dict[str, int]] = {
    "published": {"demo_batch_size": 128, "gen_replay_buffer_capacity": 4096, "n_disc_updates_per_round": 8},
    "example": {"demo_batch_size": 1024, "gen_replay_buffer_capacity": 512, "n_disc_updates_per_round": 8},
}


def main() -> None:
    options = parsed()
    if options.inside:
        measure(options)
        return
    folder = Path(options.venv).parent / "demonstrations"
    for seed in range(options.seeds):
        export(Path(options.study), options.task, seed, folder)
    python = environment(Path(options.venv))
    words = ["--inside", "--task", options.task, "--demos", str(folder), "--settings", options.settings]
    words += ["--parallel"] if options.parallel else []
    numbers = {"--steps": options.steps, "--seeds": options.seeds, "--envs": options.envs}
    words += [str(word) for pair in numbers.items() for word in pair] + ["--out", options.out]
    blind = {**os.environ, "MUJOCO_GL": "disabled"}  # torch and an EGL context do not get on in that environment
    subprocess.run([str(python), "-E", __file__, *words], check=True, env=blind)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--study", default="runs/benchmarks/gail", help="folder of our study, with its record")
    parser.add_argument("--task", default="Hopper-v5")
    parser.add_argument("--settings", choices=tuple(LEARNER), default="published")
    parser.add_argument("--steps", type=int, default=500_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--parallel", action="store_true", help="each of its environments in a process of its own")
    parser.add_argument("--venv", default="runs/peer/venv")
    parser.add_argument("--out", default=str(HERE / "peer"))
    parser.add_argument("--demos")
    parser.add_argument("--inside", action="store_true")
    return parser.parse_args()


def export(study: Path, task: str, draw: int, folder: Path) -> None:
    """Write the demonstrations of one draw as plain arrays."""
    import numpy as np

    from experiments.common.record import Record
    from experiments.gail.study import Gail

    episodes = Gail().demonstrations(task, draw, Record(study), progress=True)
    names = episodes[0].spec.observation.names
    arrays: dict[str, Any] = {f"obs_{i}": e.flat_obs(names).astype(np.float64) for i, e in enumerate(episodes)}
    arrays |= {f"acts_{i}": e.executed_actions.astype(np.float32) for i, e in enumerate(episodes)}
    ends = np.array([bool(e.terminated[-1]) for e in episodes])
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(shown_in(folder, task, draw), ends=ends, **arrays)


def shown_in(folder: Path, task: str, draw: int) -> Path:
    """Return the file of a draw."""
    return folder / f"{task}-{draw}.npz"


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
    kept = Path(options.demos).parent / options.task
    kept.mkdir(parents=True, exist_ok=True)
    name = f"{options.task}-{options.settings}-{options.envs}{'-parallel' * options.parallel}"
    done = [one_seed(options, seed, kept / f"{name}-{options.steps}-{seed}.json") for seed in range(options.seeds)]
    found = {
        "task": options.task,
        "library": LIBRARY,
        "settings": f"{options.settings} settings",
        "worlds": options.envs,
        "processes": "a process each" if options.parallel else "one process",
        "steps": options.steps,
        "cores": os.cpu_count(),
        "returns": [one["returns"] for one in done],
        "train_s": sum(one["train_s"] for one in done) / len(done),
        "each_train_s": [one["train_s"] for one in done],
    }
    Path(options.out).mkdir(parents=True, exist_ok=True)
    (Path(options.out) / f"{name}.json").write_text(json.dumps(found, indent=1) + "\n")


def one_seed(options: argparse.Namespace, seed: int, kept: Path) -> dict:
    """Train and judge one policy, unless that was done before."""
    if kept.exists():
        return json.loads(kept.read_text())
    import numpy as np
    import torch
    from imitation.data.types import Trajectory
    from imitation.data.wrappers import RolloutInfoWrapper
    from imitation.util.util import make_vec_env

    torch.set_num_threads(1)
    name, data = options.task.replace("-v5", "-v4"), np.load(shown_in(Path(options.demos), options.task, seed))
    demos = [
        Trajectory(data[f"obs_{i}"], data[f"acts_{i}"], None, terminal=bool(end)) for i, end in enumerate(data["ends"])
    ]
    venv = make_vec_env(
        name, rng=np.random.default_rng(seed), n_envs=options.envs, parallel=options.parallel,
        post_wrappers=[lambda env, _: RolloutInfoWrapper(env)],
    )  # fmt: skip
    trainer = trainer_of(options, venv, demos, seed, kept.with_suffix(".log"))
    started = time.perf_counter()
    trainer.train(options.steps)
    train_s = time.perf_counter() - started
    venv.close()
    found = {"returns": judged(name, trainer.gen_algo), "train_s": train_s}
    kept.write_text(json.dumps(found))
    return found


def trainer_of(options: argparse.Namespace, venv: Any, demos: list, seed: int, log: Path) -> Any:
    """Return the library's GAIL with one of its own settings."""
    import torch
    from imitation.algorithms.adversarial.gail import GAIL
    from imitation.policies.base import NormalizeFeaturesExtractor
    from imitation.rewards.reward_nets import BasicRewardNet, NormalizedRewardNet
    from imitation.util import logger
    from imitation.util.networks import RunningNorm
    from stable_baselines3 import PPO

    published = options.settings == "published"
    network: dict[str, Any] = {
        "activation_fn": torch.nn.ReLU,
        "features_extractor_class": NormalizeFeaturesExtractor,
        "features_extractor_kwargs": {"normalize_class": RunningNorm},
        "net_arch": {"pi": [64, 64], "vf": [64, 64]},
    }
    learner = PPO(
        "MlpPolicy", venv, seed=seed, device="cpu", n_steps=ROLLOUT[options.settings] // options.envs,
        policy_kwargs=network if published else None, **LEARNER[options.settings],
    )  # fmt: skip
    reward: Any = BasicRewardNet(venv.observation_space, venv.action_space, normalize_input_layer=RunningNorm)
    return GAIL(
        demonstrations=demos, venv=venv, gen_algo=learner, allow_variable_horizon=True,
        reward_net=NormalizedRewardNet(reward, RunningNorm) if published else reward,
        custom_logger=logger.configure(log, format_strs=["csv"]), **TRAINER[options.settings],
    )  # fmt: skip


def judged(name: str, learner: Any) -> list[float]:
    """Return the returns of the mean action on the seeds that ours is judged on."""
    import gymnasium

    env, returns = gymnasium.make(name), []
    for episode in range(EPISODES):
        obs, _ = env.reset(seed=EVALUATION_SEED + episode)
        total, over = 0.0, False
        while not over:
            obs, paid, ended, cut, _ = env.step(learner.predict(obs, deterministic=True)[0])
            total, over = total + float(paid), ended or cut
        returns.append(total)
    return returns


if __name__ == "__main__":
    main()

"""Train a small policy that flies while it learns, in a process of its own: ``python -m ... NAME RUN``."""

from __future__ import annotations

import sys
from typing import Any

from aerial_il.algorithms.airl import AIRL
from aerial_il.algorithms.dac import DAC
from aerial_il.algorithms.gail import GAIL
from aerial_il.algorithms.ppo import PPO
from aerial_il.algorithms.sac import SAC
from aerial_il.algorithms.sqil import SQIL
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, demonstrations
from tests.algorithms.made import made

POLICY = SquashedGaussian(hidden=(8,))
STOP = 300
EVERY: dict[str, Any] = {"steps": 480, "log_every": 60, "evaluate_every": 100, "checkpoint_every": 40, "batch_size": 16}
OFF: dict[str, Any] = {
    **EVERY,
    "warmup": 60,
    "utd_ratio": 0.3,
    "critic_hidden": (8,),
    "buffer_size": 300,
    "lr_floor": 0.1,
}
ON: dict[str, Any] = {**EVERY, "rollout": 48, "epochs": 2, "critic_hidden": (8,)}
JUDGE: dict[str, Any] = {"reward_hidden": (8,), "dropout": 0.2, "spectral_norm": True}
CLONED: dict[str, Any] = {"bc_pretrain_steps": 5, "action_noise": True}
SETTINGS: dict[str, Any] = {
    "sac": made(SAC, OFF),
    "dac": made(DAC, {**OFF, **JUDGE, **CLONED, "expert_share": 0.25, "bc_weight": 1.0}),
    "sqil": made(SQIL, OFF),
    "ppo": made(PPO, ON),
    "gail": made(GAIL, {**ON, **JUDGE, **CLONED, "reward_batch": 32, "buffer_size": 200, "warmup": 100}),
    "airl": made(AIRL, {**ON, **JUDGE, "reward_batch": 32, "buffer_size": 200}),
}


def evaluate(policy: Any, step: int) -> dict[str, float]:
    """Stand in for rollouts: a number that depends on the weights."""
    return {"weight": float(next(policy.network.parameters()).detach().sum())}


def train(name: str, run: str, **changes: Any) -> Any:
    data = None if name in ("sac", "ppo") else demonstrations(4, ends_at_success=True)
    env = Drift(3, ends_at_success=data is not None)
    options: dict[str, Any] = {"env": env, "run": run, "evaluate": evaluate, "progress": False, "seed": 3, **changes}
    return SETTINGS[name].train(data, POLICY, **options)


if __name__ == "__main__":
    train(sys.argv[1], sys.argv[2])

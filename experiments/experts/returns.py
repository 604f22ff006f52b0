"""Returns of an expert and of a policy without a plan in the same time: whether the reward means anything."""

from __future__ import annotations

import numpy as np

import aerial_il
from aerial_il.core.contracts import Policy, attach
from aerial_il.evaluation.baselines import Random
from aerial_il.suite.batch import BatchEnvironment
from experiments.common.report import Row


def returns_row(robot: str, task: str, *, seed: int, episodes: int, threads: int) -> Row:
    """Fly both for the task's whole time limit, success or not, and compare the sums of rewards.

    Both fly the same seeds; a crash ends the income. The success flag and the sparse reward are compared on the way.
    """
    env = aerial_il.load_batch(robot, task, num_envs=episodes, num_threads=threads)
    try:
        expert, honest = _mean_return(env, aerial_il.expert(robot, task), seed)
        random, _ = _mean_return(env, Random(), seed)
    finally:
        env.close()
    return {
        "robot": robot, "task": task, "expert_return": round(expert, 1), "random_return": round(random, 1),
        "ratio": round(expert / max(random, 1e-9), 2), "sparse_is_success": honest,
    }  # fmt: skip


def _mean_return(env: BatchEnvironment, policy: Policy, seed: int) -> tuple[float, bool]:
    attach(policy, env)
    obs, total, honest = env.reset(seed), np.zeros(env.num_envs), True
    policy.reset()
    flying = np.ones(env.num_envs, bool)
    for _ in range(env.spec.max_steps):
        result = env.step(policy.act(obs), flying)
        obs = result.obs
        total += np.where(flying, result.reward, 0.0)
        honest &= bool((result.info["sparse_reward"] == result.info["success"]).all())
        flying &= ~result.terminated
        if not flying.any():
            break
    return float(total.mean()), honest

"""How often the experts succeed: every claimed cell in every tier, over seeds that nothing was tuned on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import aerial_il
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate


def run(*, tiers: Sequence[str], episodes: int, seed: int, num_envs: int, threads: int) -> dict[str, Any]:
    """Fly the expert of every cell.

    Args:
        tiers: names of the disturbance tiers.
        episodes: seeds flown per cell and tier, from ``seed`` on.
        seed: the first seed.
        num_envs: worlds flown at once.
        threads: simulation threads; 0 for all cores.

    Returns:
        ``experts``: one row per cell and tier with count, rate and 95 % Wilson interval of the successes.
    """
    rows = []
    for robot, task in aerial_il.list_cells():
        for tier in tiers:
            env = aerial_il.load_batch(robot, task, num_envs=min(num_envs, episodes), tier=tier, num_threads=threads)
            try:
                result = evaluate(
                    env, aerial_il.expert(robot, task), range(seed, seed + episodes), policy_name="expert"
                )
            finally:
                env.close()
            rows.append(_row(result))
    return {"experts": rows}


def _row(result: EvaluationResult) -> dict[str, Any]:
    low, high = result.success["ci95"]
    return {
        "robot": result.robot,
        "task": result.task,
        "tier": result.tier,
        "success": result.success["count"],
        "episodes": len(result.episodes),
        "percent": round(100 * result.success["rate"], 1),
        "ci95_low": round(100 * low, 1),
        "ci95_high": round(100 * high, 1),
        "crashes": sum(episode.end == "crash" for episode in result.episodes),
    }

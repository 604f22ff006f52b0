"""What a policy with eyes has in view when a flight begins, and how long it takes to look and to act."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from aerial_il.core.contracts import BatchEnv, attach
from aerial_il.core.seeding import torch_threads
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import wilson
from aerial_il.policies.perception.policy import PerceivingPolicy
from aerial_il.policies.perception.targets import PLACE
from experiments.common.report import Row

IN_VIEW = "in view"
WARM_UP = 20  # steps that are not timed


def begins_in_view(env: BatchEnv, policy: PerceivingPolicy, seeds: Sequence[int]) -> dict[int, bool]:
    """Return for each seed whether, at its start, every place that is estimated lies in some camera's image."""
    found = dict[int, bool]()
    places = [target for target in policy.eyes.targets.estimated if target.kind == PLACE]
    for first in range(0, len(seeds), env.num_envs):
        some = np.resize(np.array(seeds[first : first + env.num_envs]), env.num_envs)
        obs = env.reset(some)
        seen = np.ones(env.num_envs, bool)
        for place in places:
            where = place.values(obs)
            seen &= np.any([each.in_view(each.pose(obs).seen(where)) for each in policy.eyes.cameras], axis=0)
        found |= dict(zip(some.tolist(), seen.tolist(), strict=True))
    return found


def rows_of_starts(result: EvaluationResult, in_view: Mapping[int, bool]) -> Iterator[Row]:
    """Yield success of the flights that begin with all places in view, and of the others, as far as there are any."""
    for called, wanted in ((IN_VIEW, True), ("out of view", False)):
        won = [episode.success for episode in result.episodes if in_view[episode.seed] == wanted]
        if won:
            low, high = wilson(sum(won), len(won))
            shares = {"percent": np.mean(won), "flights_low": low, "flights_high": high}
            counts = {"starts": called, "success": sum(won), "episodes": len(won)}
            yield counts | {name: round(100 * float(share), 1) for name, share in shares.items()}


def row_of_times(env: BatchEnv, policy: PerceivingPolicy, seed: int, steps: int) -> Row:
    """Return milliseconds of ``steps`` control steps of one world, on one thread, by percentile.

    ``render`` with the physics of a step, ``act`` from the images to the action, and ``both``.
    """
    times = np.zeros((steps, 2))
    with torch_threads(1):
        attach(policy, env)
        policy.reset()
        obs, begins = env.reset(np.array([seed])), False
        for step in range(steps):
            if begins:
                obs = env.reset(np.array([seed + step]))
                policy.reset()
            started = time.perf_counter()
            actions = policy.act(obs)
            acted = time.perf_counter()
            result = env.step(actions)
            times[step] = acted - started, time.perf_counter() - acted
            obs, begins = result.obs, bool((result.terminated | result.truncated | result.info["success"])[0])
    shown = {"act": times[WARM_UP:, 0], "render": times[WARM_UP:, 1], "both": times[WARM_UP:].sum(1)}
    return {
        f"{name}_{called}_ms": round(float(1e3 * np.percentile(values, at)), 2)
        for name, values in shown.items()
        for called, at in (("median", 50), ("p99", 99))
    }

"""Fly a policy over fixed seeds: a queue of seeds feeds n worlds, and every seed is flown exactly once."""

import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from aerial_il.core import checkpoint
from aerial_il.core.contracts import (
    BatchEnv,
    Observation,
    PhasedPolicy,
    Policy,
    StorablePolicy,
    attach,
    begin_episodes,
    phase_names_of,
)
from aerial_il.core.errors import InvalidValueError, NonFiniteActionError, SimulationDivergedError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import provenance
from aerial_il.core.specs import EnvSpec
from aerial_il.evaluation.journal import Journal, Kept
from aerial_il.evaluation.metrics import measure
from aerial_il.evaluation.result import EvaluationResult, Flight
from aerial_il.evaluation.traces import Trace, TraceBuffer
from aerial_il.policies.parts.execution import AS_TRAINED
from aerial_il.suite.late import LateBatch


def evaluate(
    env: BatchEnv,
    policy: Policy,
    seeds: Iterable[int],
    *,
    policy_name: str,
    origin: Mapping[str, Any] | None = None,
    journal: Journal | None = None,
    progress: bool = True,
) -> EvaluationResult:
    """Judge a policy in closed loop.

    Every world flies until its first success, a crash, the loss of its object or the time limit, then takes the next
    seed; where ``env`` says that its episodes do not end at success (``ends_at_success`` is False), success is judged
    at the end. The result does not depend on the number of worlds, as long as the policy treats each row of a batch
    alike.

    Args:
        env: a batch environment (``aerial_il.load_batch``).
        policy: what acts; experts are attached to ``env``.
        seeds: distinct non-negative episode seeds.
        policy_name: how the result names the policy, e.g. ``expert`` or a run folder.
        origin: plain values to keep in the result's provenance, e.g. the command.
        journal: keeps each flight on disk as it ends; what it holds already is not flown again.
        progress: show a progress bar.

    Returns:
        The records of all episodes in the order of ``seeds``.

    Raises:
        SimulationDivergedError: the policy or the physics gave NaN or infinity; names seed and step.
        InvalidValueError: seeds repeat, or the policy's actions do not fit the environment.
    """
    order = _checked(seeds)
    kept = journal.read(order) if journal else {}
    bar = Progress(total=len(order), initial=len(kept), desc=f"evaluate {policy_name}", unit="ep", disable=not progress)
    with bar:
        for each in _judged(env, policy, [seed for seed in order if seed not in kept]):
            kept[each.record.seed] = each
            if journal:
                journal.keep(each)
            bar.set_postfix_str(f"success {sum(k.record.success for k in kept.values())}/{len(kept)}", refresh=False)
            bar.update()
    return EvaluationResult(
        robot=env.spec.robot,
        task=env.spec.task,
        tier=env.spec.tier,
        policy=policy_name,
        episodes=tuple(kept[seed].record for seed in order),
        provenance=origin_of(env, policy)
        | {"wall_time_s": round(sum(each.wall_s for each in kept.values()), 3)}
        | dict(origin or {}),
        flights={seed: kept[seed].flight for seed in order},
    )


def _judged(env: BatchEnv, policy: Policy, seeds: list[int]) -> Iterator[Kept]:
    """Fly the seeds, if there are any, and yield each episode with the wall time since the one before."""
    clock = time.perf_counter()
    for trace in rollouts(env, policy, seeds) if seeds else ():
        now = time.perf_counter()
        yield Kept(measure(trace, env.spec), Flight.of(trace, phase_names_of(policy)), now - clock)
        clock = now


def rollouts(env: BatchEnv, policy: Policy, seeds: Iterable[int]) -> Iterator[Trace]:
    """Fly every seed once and yield the episodes as they end.

    Args and errors are those of :func:`evaluate`. With fewer seeds than worlds the spare worlds stand still.
    """
    order = _checked(seeds)
    waiting = deque(order[env.num_envs :])
    current = np.resize(np.array(order, dtype=np.int64), env.num_envs)
    flying = np.arange(env.num_envs) < len(order)
    buffer = TraceBuffer(env.spec, env.num_envs)
    attach(policy, env)
    obs = env.reset(current)
    begin_episodes(policy, current)
    while flying.any():
        actions = _act(policy, obs, env.spec, current, buffer.steps, flying)
        result = env.step(actions, flying)
        obs = result.obs
        phase = policy.phase if isinstance(policy, PhasedPolicy) else None
        buffer.add(actions, result, phase, flying)
        success, crash = result.info["success"], result.info.get("crash", result.terminated)
        dropped = result.info.get("dropped", np.zeros(env.num_envs, bool))
        ended = flying & (success & env.ends_at_success | result.terminated | result.truncated)
        for world in np.flatnonzero(ended):
            won, seed = bool(success[world] and not crash[world]), int(current[world])
            yield buffer.cut(int(world), seed=seed, success=won, crash=bool(crash[world]), dropped=bool(dropped[world]))
        renewed = _take_next(waiting, ended, current, flying)
        if renewed.any():
            obs = env.reset(current, renewed)
            begin_episodes(policy, current, renewed)


def _take_next(waiting: deque[int], ended: np.ndarray, current: np.ndarray, flying: np.ndarray) -> np.ndarray:
    """Give the worlds in ``ended`` their next seeds in ``current``, stop the others; return which got one."""
    renewed = np.zeros_like(ended)
    for world in np.flatnonzero(ended):
        if waiting:
            current[world], renewed[world] = waiting.popleft(), True
        else:
            flying[world] = False
    return renewed


def _checked(seeds: Iterable[int]) -> list[int]:
    order = [int(seed) for seed in seeds]
    if not order:
        raise InvalidValueError("There are no seeds to evaluate; give at least one episode.")
    if min(order) < 0:
        raise InvalidValueError(f"Seed {min(order)} is negative; episode seeds start at 0.")
    if len(set(order)) < len(order):
        twice = next(seed for seed in order if order.count(seed) > 1)
        raise InvalidValueError(f"Seed {twice} is given twice; each episode must be flown once.")
    return order


def _act(
    policy: Policy, obs: Observation, spec: EnvSpec, seeds: np.ndarray, steps: np.ndarray, flying: np.ndarray
) -> np.ndarray:
    """Return the policy's actions (n, Da), finite wherever a world flies; errors name seed and step."""
    try:
        actions = policy.act(obs)
    except NonFiniteActionError as error:
        world = error.worlds[0]
        what = f"The policy met a non-finite {error.what}"
        raise SimulationDivergedError(what, seed=int(seeds[world]), step=int(steps[world])) from error
    shape, expected = np.shape(actions), (len(seeds), spec.action.size)
    if shape != expected:
        raise InvalidValueError(f"The policy's actions have shape {shape}; the environment takes {expected}.")
    broken = flying & ~np.isfinite(actions).all(axis=1)
    if broken.any():
        world = int(np.argmax(broken))
        label = spec.action.labels[int(np.argmin(np.isfinite(actions[world])))]
        what = f"Action {label!r} of the policy became non-finite"
        raise SimulationDivergedError(what, seed=int(seeds[world]), step=int(steps[world]))
    return actions


def weights_of(policy: Policy) -> str | None:
    """Return the SHA-256 of a policy's weights, of its file or of its code; None of what is part of this package."""
    saved = policy.to_checkpoint() if isinstance(policy, StorablePolicy) else None
    return checkpoint.digest(saved) if saved else getattr(policy, "sha256", None)


def known_by(policy: Policy) -> dict[str, str]:
    """Return what a recording keeps of :func:`weights_of`: what is called alike need not be the same."""
    weights = weights_of(policy)
    return {"policy_sha256": weights[:12]} if weights else {}


def _instruction(policy: Policy, spec: EnvSpec) -> dict[str, str]:
    """Return what a policy is told to do, and the wording that it takes that for, where this is another."""
    told = getattr(policy, "told", None)
    said = {"instruction": spec.instruction if told is None else told}
    meant = getattr(policy, "understood", None)
    return {**said, **({} if meant in (None, said["instruction"]) else {"understood": meant})}


def origin_of(env: BatchEnv, policy: Policy) -> dict[str, Any]:
    """Return where a result of ``policy`` in ``env`` comes from: code, packages, machine, environment and weights."""
    spec, torch = env.spec, sys.modules.get("torch")
    return {
        **provenance(),
        "engine": env.engine,
        "environment": {
            **_instruction(policy, spec),
            "action_level": spec.action.level,
            **{name: getattr(spec, name) for name in ("controller", "control_dt_s", "max_steps")},
            "num_envs": env.num_envs,
            "disturbances": dict(spec.disturbances),
            "options": dict(spec.options),
            **({"latency": env.latency.said} if isinstance(env, LateBatch) else {}),
            **({"execution": said} if (said := getattr(policy, "execution", AS_TRAINED).said) else {}),
        },
        "policy_sha256": weights_of(policy),
        "observations": getattr(policy, "observations", "truth"),
        "torch_threads": torch.get_num_threads() if torch else None,
    }

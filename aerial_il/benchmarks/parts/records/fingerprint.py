"""Fingerprints of what decides a result besides its settings: how the environment behaves, and the code that learns."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

import numpy as np

import aerial_il
from aerial_il.core.contracts import BatchEnv, Expert
from aerial_il.core.provenance import package_versions

PROBED_SEEDS, PROBE_NOISE, LONGEST_PROBE = (4_000_000, 4_000_001), 0.3, 1500
PACKAGE = Path(aerial_il.__file__).parent
ROOMS = sorted(file.parent for file in (PACKAGE / "algorithms").glob("*/__init__.py"))  # what algorithms share
LEARNING = (PACKAGE / "policies", *ROOMS, *(PACKAGE / "data" / f"{name}.py" for name in ("windows", "waypoints")))


@cache
def flight_fingerprint(robot: str, task: str, tier: str, horizon: int | None = None) -> str:
    """Return a fingerprint of how an environment behaves: a hash over two noisy flights of its expert.

    Observations, rewards, successes and crashes are hashed. Records keep it under the key ``ground``, an older name
    that is part of their digests.

    Whatever moves a flight by one bit gives another fingerprint: physics, controller, observation, reward, success,
    disturbance or expert. What leaves flights as they are, a faster kernel or a renamed function, gives the same one.
    Whatever these two flights do not meet goes unnoticed.

    Args:
        robot, task, tier: registry names. horizon: of the episodes, in steps; None for the task's own.
    """
    env = aerial_il.load_batch(robot, task, num_envs=len(PROBED_SEEDS), tier=tier, num_threads=1, horizon=horizon)
    try:
        return _flown(env, aerial_il.expert(robot, task, noise=PROBE_NOISE))
    finally:
        env.close()


def _flown(env: BatchEnv, expert: Expert) -> str:
    found = hashlib.sha256()
    expert.attach(env)
    obs = env.reset(np.array(PROBED_SEEDS))
    expert.reset()
    flying = np.ones(env.num_envs, bool)
    for _ in range(min(env.spec.max_steps, LONGEST_PROBE)):
        result = env.step(expert.act(obs), flying)
        obs, success = result.obs, result.info["success"]
        parts = (*(obs[name] for name in sorted(obs)), result.reward, success, result.terminated)
        for values in parts:
            found.update(np.ascontiguousarray(values[flying]).tobytes())
        flying &= ~(success & env.ends_at_success | result.terminated | result.truncated)
        if not flying.any():
            break
    return found.hexdigest()[:16]


@cache
def learning_code(*algorithms: str) -> dict[str, str]:
    """Return what decides a training besides its data and settings: digest of the code, version of torch.

    Args:
        algorithms: names of those that train, e.g. ``bc``.
    """
    files = [PACKAGE / "algorithms" / f"{name}.py" for name in algorithms]
    files += [file for part in LEARNING for file in _sources(part)]
    return {"code": code_digest(files), "torch": package_versions().get("torch", "")}


def code_digest(files: list[Path]) -> str:
    """Return a digest of what Python files do: comments, docstrings and layout do not count."""
    found = hashlib.sha256()
    for file in sorted(files):
        found.update(file.relative_to(file.parents[1]).as_posix().encode())
        found.update(ast.dump(_without_docstrings(ast.parse(file.read_text(encoding="utf-8")))).encode())
    return found.hexdigest()[:16]


def _sources(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = node.body[ast.get_docstring(node, clean=False) is not None :] or [ast.Pass()]
    return tree

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
RESOLUTION, OFFSET = 1e-4, 0.381966  # of what is hashed; round values, which many are, lie far from where cells meet
PACKAGE = Path(aerial_il.__file__).parent
SET_APART = (  # groups of parts that only some algorithms use: the code of the others is what it would be without them
    ("algorithms.decisions", "algorithms.run.judged_first", "policies.parts.residual"),
    ("algorithms.interactive",),
)
ROOMS = sorted(file.parent for file in (PACKAGE / "algorithms").glob("*/__init__.py"))  # what algorithms share
LEARNING = (PACKAGE / "policies", *ROOMS, *(PACKAGE / "data" / f"{name}.py" for name in ("windows", "waypoints")))


@cache
def flight_fingerprint(robot: str, task: str, tier: str, horizon: int | None = None) -> str:
    """Return a fingerprint of how an environment behaves: a hash over two noisy flights of its expert.

    Observations, rewards, successes and crashes are hashed, in cells of ``RESOLUTION``. Records keep it under the key
    ``ground``, an older name that is part of their digests.

    Whatever moves flights visibly gives another fingerprint: physics, controller, observation, reward, success,
    disturbance or expert. A flight has some ten thousand values, so that moving them all by 1e-7 already takes several
    into other cells. What leaves flights as they are, a faster kernel or a renamed function, gives the same one, and
    so does another processor, on which the mathematical functions round otherwise: with and without fused
    multiply-add, values differ by 1e-13, and by 1e-8 at the moment of a contact. Whatever these two flights do not
    meet goes unnoticed.

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
            found.update(_cells(values[flying]).tobytes())
        flying &= ~(success & env.ends_at_success | result.terminated | result.truncated)
        if not flying.any():
            break
    return found.hexdigest()[:16]


def _cells(values: np.ndarray) -> np.ndarray:
    """Return which cells of ``RESOLUTION`` values lie in, as whole numbers without negative zeros."""
    return np.floor(np.ascontiguousarray(values, float) / RESOLUTION + OFFSET) + 0.0


@cache
def learning_code(*algorithms: str) -> dict[str, str]:
    """Return what decides a training besides its data and settings: digest of the code, version of torch.

    A group that is set apart counts where one of the algorithms imports from it, and nowhere else.

    Args:
        algorithms: names of those that train, e.g. ``bc``.
    """
    files = [PACKAGE / "algorithms" / f"{name}.py" for name in algorithms]
    unused = (group for group in SET_APART if not any(imports(file, group) for file in files))
    apart = tuple(module for group in unused for module in group)
    files += [file for part in LEARNING for file in _sources(part) if not _is_one_of(file, apart)]
    return {"code": code_digest(files, apart), "torch": package_versions().get("torch", "")}


def code_digest(files: list[Path], apart: tuple[str, ...] = ()) -> str:
    """Return a digest of what Python files do: comments, docstrings and layout do not count.

    Args:
        apart: modules of the package that do not count either, nor do imports of them, nor branches (``if``) whose
            condition names what they bring.
    """
    found = hashlib.sha256()
    for file in sorted(files):
        found.update(file.relative_to(file.parents[1]).as_posix().encode())
        found.update(_effective(file.read_text(encoding="utf-8"), apart).encode())
    return found.hexdigest()[:16]


@cache
def _effective(source: str, apart: tuple[str, ...]) -> str:
    """Return what counts of a file's source; see :func:`code_digest`."""
    tree = _without_docstrings(ast.parse(source))
    return ast.dump(_Without(apart).visit(tree) if apart else tree)


def imports(file: Path, modules: tuple[str, ...]) -> bool:
    """Whether a Python file imports from one of the ``modules`` of the package, or from one below."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return any(isinstance(node, ast.ImportFrom) and _is_from(node, modules) for node in ast.walk(tree))


class _Without(ast.NodeTransformer):
    """Takes imports of some modules out of a tree, and branches whose condition names what these bring."""

    def __init__(self, modules: tuple[str, ...]) -> None:
        self._modules, self._names = modules, set[str]()

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.ImportFrom | None:
        if not _is_from(node, self._modules):
            return node
        self._names |= {alias.asname or alias.name for alias in node.names}
        return None

    def visit_If(self, node: ast.If) -> ast.AST | None:
        named = {part.id for part in ast.walk(node.test) if isinstance(part, ast.Name)}
        return None if named & self._names else self.generic_visit(node)


def _is_from(node: ast.ImportFrom, modules: tuple[str, ...]) -> bool:
    return any(f"{node.module}.".startswith(f"{PACKAGE.name}.{module}.") for module in modules)


def _is_one_of(file: Path, modules: tuple[str, ...]) -> bool:
    """Whether a file of the package is one of the modules or lies below one."""
    dotted = ".".join(file.relative_to(PACKAGE).with_suffix("").parts)
    return any(f"{dotted}.".startswith(f"{module}.") for module in modules)


def _sources(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = node.body[ast.get_docstring(node, clean=False) is not None :] or [ast.Pass()]
    return tree

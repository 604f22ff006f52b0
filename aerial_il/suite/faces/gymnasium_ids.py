"""Gymnasium's ids ``aerial_il/<task>-<robot>-v0``, there as soon as this package and Gymnasium are imported.

Neither package is slowed down by the other: names are read off the registries without importing a robot or a task, and
Gymnasium, where it is not yet imported, is given the ids when it is.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from aerial_il import robots
from aerial_il.suite import tasks

SINGLE = "aerial_il.suite.faces.gymnasium_env:SingleEnv"
VECTOR = "aerial_il.suite.faces.gymnasium_vector:VectorEnvironment"


def gymnasium_id(robot: str, task: str) -> str:
    """Id of a cell."""
    return f"aerial_il/{task}-{robot}-v0"


def known_spec(robot: str, task: str) -> str | None:
    """Return Gymnasium's specification, as JSON, of an environment that is registered, ours or its own; else None.

    Args:
        robot: of ours, or ``gymnasium`` where ``task`` is an id. Names are looked up, and nothing is imported for them.
    """
    import gymnasium

    spec = gymnasium.registry.get(task if robot == "gymnasium" else gymnasium_id(robot, task))
    return None if spec is None else spec.to_json()


def register() -> None:
    """Register every robot with every task; one that a robot cannot do says so when it is made."""
    import gymnasium

    for robot in robots.names():
        for task in tasks.names():
            cell = {"robot": robot, "task": task}
            gymnasium.register(gymnasium_id(**cell), entry_point=SINGLE, vector_entry_point=VECTOR, kwargs=cell)


def register_when_imported() -> None:
    """Register now if Gymnasium is imported, or else at the moment it is."""
    if "gymnasium" in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, _WaitForGymnasium())


class _WaitForGymnasium(MetaPathFinder):
    """Finds Gymnasium as Python would, and has the ids registered once it is loaded."""

    _asks = False

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != "gymnasium" or self._asks:
            return None
        self._asks = True  # whoever else finds it
        try:
            spec = importlib.util.find_spec(fullname)
        finally:
            self._asks = False
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                register()

            spec.loader.exec_module = load_and_register
        return spec

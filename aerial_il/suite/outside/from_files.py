"""Checks of environments that a file names: registered ones only, never a module to import.

``gymnasium.make("pkg.mod:X-v0")`` imports ``pkg.mod``, which is code. A policy, dataset or run may come from
anybody, so only a key that somebody types, or passes in Python, may name a module.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec

DECIDED_HERE = ("key", "name", "make", "source", "num_envs", "processes")  # arguments of loaders that are no options


def checked_key(spec: EnvSpec, typed: str | None = None) -> str:
    """Return the key of an environment from outside as a file names it.

    Args:
        spec: out of the file. typed: the key that the user typed beside it, which may name a module.

    Raises:
        InvalidValueError: it names a module to import, and nobody typed it.
    """
    key = f"{spec.robot}:{spec.task}"
    if key != typed and ":" in spec.task:
        module = spec.task.partition(":")[0]
        raise InvalidValueError(
            f"A file names the environment {key}, which would import the module {module}: that is code, and files do "
            f"not decide what runs. If you trust {module}, type it: env={key} (in Python: pass the environment)."
        )
    return key


def checked_options(spec: EnvSpec) -> dict[str, Any]:
    """Return how a file says that an environment from outside is made.

    Raises:
        InvalidValueError: it sets what is not its to set, or a text among the values names a module as ids do.
    """
    for name, value in spec.options.items():
        if name in DECIDED_HERE:
            raise InvalidValueError(f"A file sets {name}={value} of {spec.robot}:{spec.task}, which no file may set.")
        if name != "success" and any(":" in text for text in _texts(value)):
            hint = "Make the environment in Python: aerial_il.load_gymnasium(...)."
            raise InvalidValueError(
                f"A file sets {name}={value} of {spec.robot}:{spec.task}, which may name a module to import. {hint}"
            )
    return dict(spec.options)


def _texts(value: Any) -> list[str]:
    if isinstance(value, Mapping):
        return [text for pair in value.items() for each in pair for text in _texts(each)]
    if isinstance(value, list | tuple):
        return [text for each in value for text in _texts(each)]
    return [value] if isinstance(value, str) else []

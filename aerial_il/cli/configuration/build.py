"""Build objects from ``_target_`` and values: our own and torch's optimisers only, for ``_target_`` is code."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError

ALLOWED = ("aerial_il", "torch.optim")


def build(settings: Mapping[str, Any]) -> Any:
    """Call what ``_target_`` names with the other entries as keyword arguments; nested ``_target_`` are built first.

    Raises:
        InvalidValueError: no ``_target_``, one outside ``aerial_il.*`` and ``torch.optim.*``, or one that is not there.
        UnknownNameError: a key that the constructor does not take.
    """
    return build_all(settings)[0]


def build_all(*settings: Mapping[str, Any]) -> list[Any]:
    """Build several objects as :func:`build` does; every ``_target_`` is checked before the first one is imported."""
    for target in _targets(list(settings)):
        _check_allowed(target)
    for one in settings:
        if "_target_" not in one:
            raise InvalidValueError(f"Nothing to build: no _target_ among {', '.join(one) or 'no keys'}.")
    return [_built(one) for one in settings]


def locate(target: str) -> Any:
    """Import and return the class or function that ``target`` names, after checking that it is allowed."""
    _check_allowed(target)
    module_name, _, attribute = target.rpartition(".")
    try:
        found = getattr(importlib.import_module(module_name), attribute)
    except (ModuleNotFoundError, AttributeError) as error:
        raise InvalidValueError(f"_target_={target} is not there: {error}.") from error
    home = getattr(found, "__module__", "") or ""
    if not callable(found) or not _is_allowed(f"{home}."):
        raise InvalidValueError(f"_target_={target} is not a class or function of {' or '.join(ALLOWED)}.")
    return found


def parameters(target: str) -> tuple[str, ...]:
    """Return the names of the arguments that ``target`` takes by keyword."""
    return tuple(inspect.signature(locate(target)).parameters)


def _built(value: Any) -> Any:
    if isinstance(value, list):
        return [_built(item) for item in value]
    if not isinstance(value, Mapping):
        return value
    inner = {str(k): _built(v) for k, v in value.items() if k != "_target_"}
    if "_target_" not in value:
        return inner
    known = parameters(value["_target_"])
    for name in inner:
        if name not in known:
            raise UnknownNameError(f"key of {value['_target_']}", name, known)
    return locate(value["_target_"])(**inner)


def _targets(value: Any) -> list[str]:
    if isinstance(value, list):
        return [target for item in value for target in _targets(item)]
    if not isinstance(value, Mapping):
        return []
    own = [str(value["_target_"])] if "_target_" in value else []
    return own + [target for item in value.values() for target in _targets(item)]


def _check_allowed(target: str) -> None:
    if not _is_allowed(target):
        allowed = " and ".join(f"{prefix}.*" for prefix in ALLOWED)
        raise InvalidValueError(f"_target_={target} is refused: only {allowed} may be named.")


def _is_allowed(target: str) -> bool:
    return any(target.startswith(f"{prefix}.") for prefix in ALLOWED)

"""Build objects from ``_target_`` and values: our own and torch's optimisers only, for ``_target_`` is code."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterable, Mapping
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.fitting import check_types

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
    _check_targets(settings)
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
        raise InvalidValueError(f"_target_={target} does not exist: {error}.") from error
    home = getattr(found, "__module__", "") or ""
    if not callable(found) or not _is_allowed(f"{home}."):
        raise InvalidValueError(f"_target_={target} is not a class or function of {' or '.join(ALLOWED)}.")
    return found


def parameters(target: str) -> tuple[str, ...]:
    """Return the names of the arguments that ``target`` takes by keyword."""
    return tuple(inspect.signature(locate(target)).parameters)


def _built(value: Mapping[str, Any] | list[Any]) -> Any:
    if isinstance(value, list):
        return [_built(item) if isinstance(item, (Mapping, list)) else item for item in value]
    nested = {str(k): _built(v) for k, v in value.items() if isinstance(v, (Mapping, list))}
    inner = {str(k): nested.get(str(k), v) for k, v in value.items() if k != "_target_"}
    if "_target_" not in value:
        return inner
    known = parameters(value["_target_"])
    for name in inner:
        if name not in known:
            raise UnknownNameError(f"key of {value['_target_']}", name, known)
    constructor = locate(value["_target_"])
    check_types(constructor, inner)
    return constructor(**inner)


def _check_targets(settings: Iterable[Mapping[str, Any]]) -> None:
    """Refuse a ``_target_`` that is not allowed, however deep it stands."""
    left: list[Any] = list(settings)
    while left:
        value = left.pop()
        if isinstance(value, Mapping):
            if "_target_" in value:
                _check_allowed(str(value["_target_"]))
            left += value.values()
        elif isinstance(value, list):
            left += value


def _check_allowed(target: str) -> None:
    if not _is_allowed(target):
        allowed = " and ".join(f"{prefix}.*" for prefix in ALLOWED)
        raise InvalidValueError(f"_target_={target} is refused: only {allowed} may be named.")


def _is_allowed(target: str) -> bool:
    return any(target.startswith(f"{prefix}.") for prefix in ALLOWED)

"""The names that the Python reference is to hold."""

import importlib
import inspect

from aerial_il.presentation.documentation.modules import SHOWN


def public_names() -> set[str]:
    """Return the full names of the functions and classes that the shown modules define and document."""
    return {f"{name}.{each}" for name in SHOWN for each in _documented(name)}


def _documented(module: str) -> list[str]:
    def own(value: object) -> bool:
        return getattr(value, "__module__", "") == module and bool(inspect.getdoc(value))

    return [name for name, value in vars(importlib.import_module(module)).items() if name[0] != "_" and own(value)]

"""The one registry: what there is of each kind, found by its file, or in other packages by an entry point.

A file in the folder of its kind is registered by being there. A package outside registers a module of the same make::

    [project.entry-points."aerial_il.task"]
    fold_cloth = "my_package.fold_cloth"

Names are listed without importing what they name.
"""

import importlib
import importlib.util
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from aerial_il.core.errors import AerialError, InvalidValueError, UnknownNameError


@dataclass(frozen=True)
class Kind:
    """Where the files of one kind lie, and what a file defines.

    Attributes:
        package: whose modules they are; packages inside it hold what they share.
        defines: the module's attribute; empty for a class that is called as the file is, whatever its capitals:
            ``SAC`` in ``sac.py``, ``CoinGate`` in ``coin.py``.
        besides: modules of that package which are none of them.
        inside: the module that defines it lies in a folder that has its name; empty where files have the names.
        hint: where to look, said beside an unknown name.
    """

    package: str
    defines: str = ""
    besides: frozenset[str] = frozenset()
    inside: str = ""
    hint: str = ""


KINDS: Mapping[str, Kind] = {
    "robot": Kind(
        "aerial_il.robots",
        "ROBOT",
        frozenset({"robot", "figures", "poise"}),
        hint="Run `aerial-il list` to see what each can do.",
    ),
    "task": Kind(
        "aerial_il.suite.tasks",
        "TASK",
        frozenset({"task", "fields", "two_cubes"}),
        hint="Run `aerial-il list` to see which robot can do which.",
    ),
    "controller": Kind("aerial_il.control.controllers", "", frozenset({"law"})),
    "disturbance": Kind("aerial_il.suite.disturbances", "", frozenset({"disturbance", "nominal"})),
    "sensor": Kind("aerial_il.suite.sensors", "", frozenset({"sensor"})),
    "expert": Kind(
        "aerial_il.experts", "EXPERT", frozenset({"expert", "gaze", "hook", "perturbation", "set_down", "staged"})
    ),
    "format": Kind("aerial_il.data.formats", "recognises"),
    "policy": Kind("aerial_il.policies"),
    "algorithm": Kind("aerial_il.algorithms"),
    "gate": Kind("aerial_il.algorithms.interactive.gates", besides=frozenset({"gate"})),
    "launcher": Kind("aerial_il.cli.launchers"),
    "sweeper": Kind("aerial_il.cli.sweepers"),
    "link": Kind("aerial_il.links", inside="link"),
    "study": Kind(
        "experiments",
        inside="study",
        hint="Studies are run from a checkout, which an installed package is not: clone the repository, run make setup "
        "there, and call .venv/bin/aerial-il bench NAME.",
    ),
}


def names(kind: str) -> tuple[str, ...]:
    """Return the names of all that is registered of a kind, in alphabetical order, without importing any of it.

    Raises:
        InvalidValueError: a package outside registers a name that is taken.
    """
    return tuple(sorted(_modules(kind)))


def module(kind: str, name: str) -> ModuleType:
    """Import and return the module that defines ``name``.

    Raises:
        UnknownNameError: nothing of that kind has the name.
        InvalidValueError: its file is no Python, or does what cannot be done.
    """
    if name not in _modules(kind):
        raise UnknownNameError(kind, name, names(kind), KINDS[kind].hint)
    place = _modules(kind)[name]
    try:
        return importlib.import_module(place)
    except AerialError:
        raise
    except (SyntaxError, TypeError, NameError, AttributeError, ValueError) as error:
        file = getattr(importlib.util.find_spec(place), "origin", place)
        raise InvalidValueError(f"{kind} {name}, {file}, cannot be read: {type(error).__name__}: {error}") from error


def get(kind: str, name: str) -> Any:
    """Return what the file ``name`` defines: a robot, a task, the class of an algorithm's settings, ….

    Raises:
        UnknownNameError: nothing of that kind has the name.
        InvalidValueError: its file defines nothing of the kind.
    """
    found, wanted = module(kind, name), KINDS[kind].defines
    if wanted:
        return _defined(found, kind, wanted)
    plain = name.replace("_", "").lower()
    own = (value for value in vars(found).values() if isinstance(value, type) and value.__module__ == found.__name__)
    if (match := next((value for value in own if value.__name__.lower() in (plain, f"{plain}{kind}")), None)) is None:
        raise InvalidValueError(f"{found.__name__} defines no class that is called as its file, {name}.")
    return match


def place(kind: str, name: str) -> str | None:
    """Return the module that defines ``name``, None where nothing is registered by it."""
    return _modules(kind).get(name)


def name_of(kind: str, settings: type) -> str:
    """Return the name by which a class of a kind is registered; empty where it is not."""
    return next((name for name, module in _modules(kind).items() if module == settings.__module__), "")


def kernel(kind: str, name: str, function: str, *, needed: bool = True) -> Any:
    """Return a compiled function that the file ``name`` defines; None where it has none and none is ``needed``.

    Raises:
        UnknownNameError: nothing of that kind has the name.
        InvalidValueError: it is missing, or a plain Python function.
    """
    place = module(kind, name)
    found = _defined(place, kind, function) if needed else getattr(place, function, None)
    if found is not None and not hasattr(found, "py_func"):
        raise InvalidValueError(f"{place.__name__}.{function} must be compiled: write @kernel above it.")
    return found


def _defined(found: ModuleType, kind: str, attribute: str) -> Any:
    if not hasattr(found, attribute):
        raise InvalidValueError(f"{found.__name__} defines no {attribute}, which a {kind} must have.")
    return getattr(found, attribute)


def _modules(kind: str) -> dict[str, str]:
    """Return name -> module."""
    found = _own(KINDS[kind])
    for name, place in outside(kind).items():
        if name in found:
            raise InvalidValueError(
                f"{place} registers a {kind} called {name}, but {found[name]} has that name: rename the entry point, "
                f"or uninstall the package that brings it."
            )
        found[name] = place
    return found


def _own(here: Kind) -> dict[str, str]:
    """Return name -> module of what lies in the folder of a kind; none where that is not installed, as studies."""
    if importlib.util.find_spec(here.package) is None:
        return {}
    folders = importlib.import_module(here.package).__path__
    if here.inside:
        files = (file for folder in folders for file in Path(folder).glob(f"*/{here.inside}.py"))
        return {file.parent.name: f"{here.package}.{file.parent.name}.{here.inside}" for file in files}
    files = (each for each in pkgutil.iter_modules(folders) if not each.ispkg and each.name not in here.besides)
    return {each.name: f"{here.package}.{each.name}" for each in files}


@cache
def outside(kind: str) -> dict[str, str]:
    """Return name -> module of what other packages bring."""
    return {point.name: point.value for point in entry_points(group=f"aerial_il.{kind}")}

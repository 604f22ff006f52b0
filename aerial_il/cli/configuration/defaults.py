"""Constructor defaults of a dataclass as plain values, read from its source: nothing is imported to show them.

Help and completion name every setting of a policy or an algorithm at once, where an import would take seconds. What is
read is what a dataclass is written with: literals, constants and their items, mappings that unpack others, other
dataclasses, and functions without arguments, which are called only if their value is wanted, as are constants that are
computed.
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from aerial_il.core.errors import InvalidValueError

TARGET = "_target_"
REQUIRED = "???"  # what OmegaConf takes for "the user must say"
_PACKAGE = Path(__file__).resolve().parents[2]
_CONTAINERS = {"dict": dict, "list": list, "tuple": list}


@dataclass(frozen=True)
class Deferred:
    """A constant that is computed, or what a function without arguments returns: its module must be imported for it."""

    module: str
    name: str

    def value(self) -> Any:
        found = getattr(importlib.import_module(self.module), self.name)
        return found() if callable(found) else found


def completed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with all that ``_target_`` takes and that ``given`` leaves at its default.

    A nested mapping that names a ``_target_`` of its own stands alone; one that names none changes the default's.

    Args:
        given: ``_target_`` and whatever differs from its defaults; without ``_target_``, only what is nested is
            completed.
    """
    return {name: _resolved(value) for name, value in _completed(given).items()}


def defaults_of(target: str) -> dict[str, Any]:
    """Return ``_target_`` and the defaults of the dataclass that ``target`` names, nested ones likewise.

    Raises:
        InvalidValueError: ``target`` is no dataclass of this package, or a default cannot be read.
    """
    return completed({TARGET: target})


def has_method(target: str, method: str) -> bool:
    """Whether ``target`` names a dataclass that has ``method``, its own or inherited."""
    module, _, name = target.rpartition(".")
    lineage = _lineage(module, name)
    return bool(lineage) and _is_dataclass(lineage[0][1]) and any(_defines(node, method) for _, node in lineage)


def classes(module: str) -> tuple[str, ...]:
    """Return the names of the classes that the file of ``module`` defines, in its order."""
    return tuple(name for name, node in _names(module).items() if isinstance(node, ast.ClassDef))


def _completed(given: Mapping[str, Any]) -> dict[str, Any]:
    usual = _fields(given[TARGET]) if TARGET in given else {}
    return {**usual, **{name: _changed(usual.get(name), value) for name, value in given.items()}}


def _changed(usual: Any, given: Any) -> Any:
    if not isinstance(given, Mapping):
        return given
    settings = isinstance(usual, Mapping) and TARGET in usual and TARGET not in given
    return _completed({TARGET: usual[TARGET], **usual, **given} if settings else given)


def _resolved(value: Any) -> Any:
    if isinstance(value, Deferred):
        return _resolved(value.value())
    if isinstance(value, Mapping):
        return {name: _resolved(inner) for name, inner in value.items()}
    return [_resolved(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def _fields(target: str) -> dict[str, Any]:
    """Return ``_target_`` and the default of each field, those of parents first, as ``dataclasses`` orders them."""
    module, _, name = str(target).rpartition(".")
    found: dict[str, Any] = {TARGET: target}
    for home, node in reversed(_lineage(module, name)):
        if _is_dataclass(node):
            found |= {field.target.id: _default(field, home) for field in node.body if _is_field(field)}  # type: ignore[union-attr]
    return found


def _lineage(module: str, name: str) -> list[tuple[str, ast.ClassDef]]:
    """Return a class and its parents in this package, in the order in which Python asks them; empty for no class."""
    home, node = _find(module, name)
    if not isinstance(node, ast.ClassDef):
        return []
    parents = [base.id for base in node.bases if isinstance(base, ast.Name)]
    found = [(home, node), *(ancestor for parent in parents for ancestor in _lineage(home, parent))]
    return [each for place, each in enumerate(found) if each not in found[place + 1 :]]


def _is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)


def _defines(node: ast.ClassDef, method: str) -> bool:
    return any(isinstance(statement, ast.FunctionDef) and statement.name == method for statement in node.body)


def _is_field(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.target, ast.Name):
        return False
    own = statement.value.keywords if isinstance(statement.value, ast.Call) else []
    hidden = any(keyword.arg == "init" and ast.unparse(keyword.value) == "False" for keyword in own)
    return not hidden and not ast.unparse(statement.annotation).startswith("ClassVar")


def _default(field: ast.AnnAssign, module: str) -> Any:
    value = field.value
    if value is None:
        return REQUIRED
    if not isinstance(value, ast.Call) or ast.unparse(value.func) not in ("field", "dataclasses.field"):
        return _value(value, module)
    said = {keyword.arg: keyword.value for keyword in value.keywords}
    if "default" in said:
        return _value(said["default"], module)
    factory = said.get("default_factory")
    if factory is None:
        return REQUIRED
    return _value(factory.body if isinstance(factory, ast.Lambda) else ast.Call(factory, [], []), module)


def _value(node: ast.expr, module: str) -> Any:
    """Return what an expression of ``module`` amounts to, as plain values."""
    try:
        return _plain(ast.literal_eval(node))
    except ValueError:
        pass
    if isinstance(node, ast.Name):
        home, found = _find(module, node.id)
        if isinstance(found, ast.expr):
            return _constant(found, home, node.id)
    if isinstance(node, (ast.Tuple, ast.List)):
        return [_value(item, module) for item in node.elts]
    if isinstance(node, ast.Dict):
        return _mapping(node, module)
    if isinstance(node, ast.Subscript) and isinstance(within := _value(node.value, module), dict):
        return within[_value(node.slice, module)]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _call(node, node.func.id, module)
    raise _unreadable(node, module)


def _mapping(node: ast.Dict, module: str) -> dict[Any, Any]:
    """Return ``{key: value, **other}``, where ``other`` is a mapping that can itself be read."""
    found: dict[Any, Any] = {}
    for key, value in zip(node.keys, node.values, strict=True):
        read = _value(value, module)
        if key is None and isinstance(read, Deferred):
            raise _unreadable(node, module)
        found |= read if key is None else {_value(key, module): read}
    return found


def _constant(node: ast.expr, module: str, name: str) -> Any:
    try:
        return _value(node, module)
    except InvalidValueError:
        return Deferred(module, name)


def _call(node: ast.Call, name: str, module: str) -> Any:
    home, found = _find(module, name)
    if isinstance(found, ast.ClassDef) and not node.args:
        changes = {str(keyword.arg): _value(keyword.value, module) for keyword in node.keywords}
        return _completed({TARGET: f"{home}.{found.name}", **changes})
    if isinstance(found, ast.FunctionDef) and not node.args and not node.keywords:
        return Deferred(home, found.name)
    if name in _CONTAINERS and found is None and len(node.args) <= 1:
        return _CONTAINERS[name](*(_value(argument, module) for argument in node.args))
    raise _unreadable(node, module)


def _unreadable(node: ast.expr, module: str) -> InvalidValueError:
    return InvalidValueError(f"{module}: the default {ast.unparse(node)} cannot be read without running it: name it.")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def _find(module: str, name: str) -> tuple[str, ast.AST | None]:
    """Return where ``name`` of ``module`` is defined, imports followed, and what it is; None for what is not ours."""
    found = _names(module).get(name)
    if isinstance(found, ast.ImportFrom):
        source = next(alias.name for alias in found.names if (alias.asname or alias.name) == name)
        return _find(str(found.module), source)
    return module, found


@cache
def _names(module: str) -> dict[str, ast.AST]:
    """Return what the file of a module of this package defines or imports at its top level, by name."""
    file = _file(module)
    found: dict[str, ast.AST] = {}
    for statement in ast.parse(file.read_text(encoding="utf-8")).body if file else ():
        if isinstance(statement, (ast.ClassDef, ast.FunctionDef)):
            found[statement.name] = statement
        elif isinstance(statement, ast.ImportFrom):
            found |= {alias.asname or alias.name: statement for alias in statement.names}
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.value:
            found[statement.target.id] = statement.value
        elif isinstance(statement, ast.Assign):
            found |= _assigned(statement)
    return found


def _assigned(statement: ast.Assign) -> dict[str, ast.AST]:
    """Return names and values of ``a = 1`` and of ``a, b = 1, 2``."""
    (target, *_), value = statement.targets, statement.value
    if isinstance(target, ast.Name):
        return {target.id: value}
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        pairs = zip(target.elts, value.elts, strict=True)
        return {name.id: each for name, each in pairs if isinstance(name, ast.Name)}
    return {}


def _file(module: str) -> Path | None:
    """Return the file of a module of this package, None for any other."""
    package, *inner = module.split(".")
    place = _PACKAGE.joinpath(*inner)
    files = (place.with_suffix(".py"), place / "__init__.py") if package == _PACKAGE.name else ()
    return next((file for file in files if file.is_file()), None)

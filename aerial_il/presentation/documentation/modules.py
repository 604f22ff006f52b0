"""The public names of the package, found in its source, and the pages that show their docstrings."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
ROOMS = (  # in the order of the layers, from what people call to what everything stands on
    *("cli", "documentation", "analysis", "benchmarks"),
    *("algorithms", "evaluation", "collection", "bridges", "inspection"),
    *("experts", "policies", "teleop", "suite", "data", "robots", "control", "core"),
)
LOGGER = "log"
LONG = 90  # characters of a value that is left to the source
INTRODUCTION = """\
# Python

Every public name of the package, by room and module, from its docstring. A name without a leading underscore is public
inside the house; what scripts may rely on from version to version is the front, [`aerial_il`](aerial_il.rst) itself,
told with examples [in Python](../python.md). What rooms are, and which stands on which:
[architecture](../architecture.md)."""


def pages() -> dict[str, str]:
    """Return path on the site -> text: one page for each folder of the package, and a list of them."""
    packages: dict[str, list[str]] = defaultdict(list)
    for module, file in modules().items():
        packages[module if file.name == "__init__.py" else module.rpartition(".")[0]].append(module)
    found = {name: _page(name, sorted(members)) for name, members in packages.items()}
    rows = [f"| [`{name}`]({name}.rst) | {_summary(name)} |" for name in sorted(found, key=_place_of)]
    index = "\n".join([INTRODUCTION, "", "| package | |", "|---|---|", *rows, ""])
    return {"python/index.md": index, **{f"python/{name}.rst": text for name, text in found.items()}}


@cache
def modules() -> dict[str, Path]:
    """Return every public module of the package and its file."""
    files = {_module_of(file): file for file in sorted(PACKAGE.rglob("*.py"))}
    return {name: file for name, file in files.items() if not any(part[0] == "_" for part in name.split("."))}


def public_names() -> set[str]:
    """Return the full names of all public modules, and of the functions, classes and constants that they define."""
    return {full for module in modules() for full in (module, *(f"{module}.{name}" for name in defined(module)))}


@cache
def defined(module: str) -> frozenset[str]:
    """Return the public names that a module defines itself, at its top level; its logger is nobody's business."""
    return frozenset(_callables(module)) | frozenset(_constants(module))


def _callables(module: str) -> list[str]:
    """Return the public functions and classes that a module defines."""
    named = (n.name for n in _body(module) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef))
    return [name for name in named if not name.startswith("_")]


def _constants(module: str) -> dict[str, str]:
    """Return the public constants and aliases that a module defines, each with the source of its value."""
    found = {}
    for node in _body(module):
        match node:
            case ast.TypeAlias(name=target, value=value) | ast.AnnAssign(target=target, value=value):
                targets = [target]
            case ast.Assign(targets=targets, value=value):
                pass
            case _:
                continue
        text = ast.unparse(value) if value else ""
        names = [leaf.id for each in targets for leaf in ast.walk(each) if isinstance(leaf, ast.Name)]
        found |= {name: text for name in names if not name.startswith("_") and name != LOGGER}
    return found


@cache
def _body(module: str) -> list[ast.stmt]:
    return ast.parse(modules()[module].read_text(encoding="utf-8")).body


def _page(package: str, members: list[str]) -> str:
    parts = [_title(package, "=")]
    for module in members:
        parts += ["" if module == package else _title(module.removeprefix(f"{package}."), "-"), _module(module)]
    return "\n".join(parts)


def _module(module: str) -> str:
    """Return the directives that show a module; constants are named one by one, for most have no docstring."""
    names = ", ".join(sorted(_callables(module)))
    lines = [f".. automodule:: {module}", *([f"   :members: {names}"] if names else []), ""]
    for name, value in _constants(module).items():
        lines += [f".. py:data:: {name}", f"   :module: {module}"]
        lines += [*([f"   :value: {value}"] if 0 < len(value) <= LONG else []), ""]
    return "\n".join(lines)


def _title(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}\n"


def _summary(module: str) -> str:
    text = ast.get_docstring(ast.parse(modules()[module].read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].replace("``", "`").replace("|", "\\|")


def _place_of(package: str) -> tuple[int, str]:
    _, _, rest = package.partition(".")
    room = rest.partition(".")[0]
    return (ROOMS.index(room) + 1 if room in ROOMS else 0, package)


def _module_of(file: Path) -> str:
    return ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")

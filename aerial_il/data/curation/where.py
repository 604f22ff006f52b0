"""Conditions on the rows of a table, as people type them: ``success and seconds < 12 and operator == 'ana'``.

The text is parsed as Python and never run: what is not a column, a constant, a comparison, ``and``, ``or``, ``not``,
``in`` or ``+ - * / // %`` is refused, and so is arithmetic on anything but numbers.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from aerial_il.core.errors import InvalidValueError, UnknownNameError

LONGEST, DEEPEST = 100_000, 50  # characters; parts within parts
EXAMPLE = "For example: where=\"success and seconds < 12 and operator == 'ana'\""
ALIASES = {"length_s": "seconds", "length": "steps", "total_reward": "return"}
CONSTANTS = {"true": True, "false": False, "null": None}
_RETURN = re.compile(r"'[^']*'|\"[^\"]*\"|\breturn\b")  # the column's name is a word of Python's, unless it is quoted
_ARITHMETIC: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod,
}  # fmt: skip
_ORDER: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip
_SAME: dict[type, Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Is: operator.eq, ast.IsNot: operator.ne,
    ast.In: lambda value, among: value in among, ast.NotIn: lambda value, among: value not in among,
}  # fmt: skip
_SIGNS = {ast.USub: operator.neg, ast.UAdd: operator.pos}
_PARTS = (
    ast.BoolOp, ast.boolop, ast.UnaryOp, ast.unaryop, ast.BinOp, ast.operator, ast.Compare, ast.cmpop, ast.Constant,
    ast.Name, ast.List, ast.Tuple, ast.Subscript, ast.expr_context,
)  # fmt: skip


@dataclass(frozen=True)
class Where:
    """A condition on a row.

    Attributes:
        text: as it was typed. tree: what it says.
    """

    text: str
    tree: ast.expr

    @staticmethod
    def parse(text: str) -> Where:
        """Return the condition that ``text`` says.

        Raises:
            InvalidValueError: it is none, or has something in it that is not allowed.
        """
        if len(text) > LONGEST:
            raise InvalidValueError(f"where= has {len(text)} characters; the maximum is {LONGEST}.")
        named = _RETURN.sub(lambda found: "total_reward" if found[0] == "return" else found[0], text)
        try:
            tree = ast.parse(named.strip(), mode="eval").body
            _check_depth(tree)
            for node in ast.walk(tree):
                _check(text, node)
        except InvalidValueError:
            raise
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise InvalidValueError(f"where={text} cannot be read ({error}). {EXAMPLE}") from None
        return Where(text, tree)

    @cached_property
    def names(self) -> set[str]:
        """The columns that it asks for; of a mapping in the provenance, such as ``settings['noise']``, its key."""
        found = {node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name)} - CONSTANTS.keys()
        return {ALIASES.get(name, name) for name in found} - self.mappings

    @cached_property
    def mappings(self) -> set[str]:
        """The mappings in the provenance that it looks into."""
        return {_mapping(node) for node in ast.walk(self.tree) if isinstance(node, ast.Subscript)}

    @property
    def clauses(self) -> list[Where]:
        """What all must hold for it to hold, or itself."""
        parts = self.tree.values if isinstance(self.tree, ast.BoolOp) and isinstance(self.tree.op, ast.And) else []
        return [Where(ast.unparse(part).replace("total_reward", "return"), part) for part in parts] or [self]

    def require(self, columns: Mapping[str, Any], origin: Mapping[str, Any]) -> None:
        """Refuse names that are neither a column nor a key of the provenance ``origin``."""
        valid = (*columns, *(key for key in origin if key not in columns))
        for name in sorted(self.names):
            if name not in valid:
                raise UnknownNameError("column", name, valid, f"where={self.text}")
        for name in sorted(self.mappings):
            if not isinstance(origin.get(name), Mapping):
                raise UnknownNameError("mapping", name, [k for k, v in origin.items() if isinstance(v, Mapping)])

    def holds(self, row: Mapping[str, Any], origin: Mapping[str, Any]) -> bool:
        """Return whether it holds for a row; ``origin``, its provenance, says what is no column.

        Raises:
            InvalidValueError: it says neither yes nor no, or compares what cannot be compared.
        """
        try:
            found = _value(self.tree, row, origin)
        except (TypeError, ArithmeticError) as error:
            raise InvalidValueError(
                f"where={self.text} cannot be said of {row.get('uid', 'a row')}: {error}."
            ) from None
        if not isinstance(found, bool):
            raise InvalidValueError(
                f"where={self.text} is no condition: of {row.get('uid')} it is {found!r}. {EXAMPLE}"
            )
        return found


def _check_depth(tree: ast.expr) -> None:
    """Refuse what is nested deeper than anybody types, level by level, as recursion would end there."""
    level: list[ast.AST] = [tree]
    for _ in range(DEEPEST):
        level = [inner for node in level for inner in ast.iter_child_nodes(node)]
    if level:
        raise ValueError(f"it is nested more than {DEEPEST} deep")


def _check(text: str, node: ast.AST) -> None:
    """Refuse a part that is not allowed, in the words of who typed it."""
    if not isinstance(node, _PARTS) or (isinstance(node, ast.BinOp) and type(node.op) not in _ARITHMETIC):
        kind = type(getattr(node, "op", node)).__name__.lower()
        allowed = "columns, constants, comparisons, and, or, not, in and + - * / // %"
        raise InvalidValueError(f"where={text} has a {kind} in it, which is not allowed; these are: {allowed}.")
    if isinstance(node, ast.UnaryOp) and not isinstance(node.op, (ast.Not, *_SIGNS)):
        raise InvalidValueError(f"where={text} has ~ in it: write not.")
    if isinstance(node, ast.Constant) and not isinstance(node.value, (bool, int, float, str, type(None))):
        raise InvalidValueError(f"where={text} has {node.value!r} in it, which no column can be.")
    if isinstance(node, ast.Subscript):
        _mapping(node)


def _mapping(node: ast.Subscript) -> str:
    """Return the mapping that ``settings['noise']`` looks into; that of ``drawn['wind']['mean']`` is ``drawn``."""
    inner = node.value
    key = node.slice.value if isinstance(node.slice, ast.Constant) else None
    if not isinstance(key, str) or not isinstance(inner, (ast.Name, ast.Subscript)):
        raise InvalidValueError(f"where={ast.unparse(node)} is no entry of a mapping, such as settings['noise'].")
    return inner.id if isinstance(inner, ast.Name) else _mapping(inner)


def _value(node: ast.expr, row: Mapping[str, Any], origin: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant():
            return node.value
        case ast.Name():
            name = ALIASES.get(node.id, node.id)
            return CONSTANTS[name] if name in CONSTANTS else row.get(name, origin.get(name))
        case ast.List() | ast.Tuple():
            return [_value(each, row, origin) for each in node.elts]
        case ast.Subscript():
            inner = origin.get(node.value.id) if isinstance(node.value, ast.Name) else _value(node.value, row, origin)
            return inner.get(node.slice.value) if isinstance(inner, Mapping) else None  # pyright: ignore
        case ast.BoolOp():
            values = (bool(_value(each, row, origin)) for each in node.values)
            return all(values) if isinstance(node.op, ast.And) else any(values)
        case ast.UnaryOp():
            inner = _value(node.operand, row, origin)
            if isinstance(node.op, ast.Not):
                return not inner
            number = _number(inner)
            return None if number is None else _SIGNS[type(node.op)](number)
        case ast.BinOp():
            left, right = (_number(_value(each, row, origin)) for each in (node.left, node.right))
            return None if left is None or right is None else _ARITHMETIC[type(node.op)](left, right)
        case ast.Compare():
            return _compared(node, row, origin)
    raise TypeError(f"{ast.unparse(node)} has no value")


def _compared(node: ast.Compare, row: Mapping[str, Any], origin: Mapping[str, Any]) -> bool:
    """Return whether each neighbour compares so with the next; what is missing is neither more nor less."""
    values = [_value(each, row, origin) for each in (node.left, *node.comparators)]
    for op, left, right in zip(node.ops, values, values[1:], strict=False):
        if type(op) in _ORDER and (left is None or right is None):
            return False
        if isinstance(op, (ast.In, ast.NotIn)) and (right is None or (left is None and isinstance(right, str))):
            right = ()
        if not (_ORDER.get(type(op)) or _SAME[type(op)])(left, right):
            return False
    return True


def _number(value: Any) -> int | float | None:
    if value is not None and not isinstance(value, (int, float)):
        raise TypeError(f"{value!r} is no number")
    return value

"""Disturbance tiers: what an episode is disturbed by, as names that can be taken apart and put together.

A tier is written ``NAME`` or ``NAME+COMPONENT-COMPONENT…``: ``gusts``, ``calm+latency``, ``hard-payload``. Components
are the disturbances of :mod:`aerial_il.suite.disturbances`, each of which says how strong it is in which tier; one that
is added has the strength it has in ``hard``, or that of its defaults if hard has none, or the one that is written
behind it: ``calm+wind:2``. Strengths are relative to the vehicle or the object they act on, so that one tier fits all.
``docs/tiers.md`` explains every number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from typing import Any
from zlib import crc32

import numpy as np

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite import disturbances
from aerial_il.suite.disturbances.disturbance import Disturbance
from aerial_il.suite.physics import episode_state as layout

MARKED = layout.USERDATA_SIZE  # memories from here on are marked
NAMES = ("calm", "breeze", "gusts", "hard")
FIRST = ("wind", "payload", "friction", "latency", "noise", "motors", "estimation")  # in names of recorded tiers
_SIGN = r"(?<!\de)[+-]"  # not that of an exponent, 1e-3
_TERM = re.compile(rf"({_SIGN})((?:(?!{_SIGN}).)*)")


@dataclass(frozen=True)
class Tier:
    """Disturbances of an episode by component.

    Attributes:
        name: canonical name; equal tiers that are put together differently have equal names.
        parts: component -> its settings, in the order of :func:`components`.
        strengths: those that were written as a number, by component.
    """

    name: str
    parts: Mapping[str, Disturbance] = field(default_factory=dict, hash=False)
    strengths: Mapping[str, float] = field(default_factory=dict, hash=False, compare=False)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components that are present."""
        return tuple(self.parts)

    @cached_property
    def memories(self) -> dict[str, slice]:
        """Where what each component remembers lies in an episode's memory: in all tiers alike, or behind a mark."""
        found, end = {}, layout.USERDATA_SIZE
        for name, part in self.parts.items():
            own = layout.MEMORIES.get(name, slice(0, 0))
            if 0 < part.memory <= own.stop - own.start:
                found[name] = own
            elif part.memory:
                found[name] = slice(end + 1, end := end + 1 + part.memory)
        return found

    @property
    def marks(self) -> dict[int, float]:
        """Place -> number in an episode's memory, which marks those behind it as this tier's."""
        return {at.start - 1: float(crc32(name.encode())) for name, at in self.memories.items() if at.start > MARKED}

    @property
    def userdata_size(self) -> int:
        """Numbers of an episode's memory."""
        return max([layout.USERDATA_SIZE, *(memory.stop for memory in self.memories.values())])

    def with_part(self, name: str, part: Disturbance | None, strength: float | None = None) -> Tier:
        """Return the same with other settings of a component; None for without.

        Args:
            name: of the component. part: its settings. strength: the number that stands for them.
        """
        parts, strengths = {**self.parts, name: part}, {**self.strengths, name: strength}
        return replace(
            self,
            parts={key: parts[key] for key in components() if parts.get(key) is not None},
            strengths={key: number for key, number in strengths.items() if number is not None},
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the components with their strengths as plain values."""
        return {name: asdict(part) for name, part in self.parts.items()}  # type: ignore[call-overload]


def names() -> tuple[str, ...]:
    """Names of all tiers, from calm to rough."""
    return NAMES


def components() -> tuple[str, ...]:
    """Names of all components, in the order in which a tier's name has them."""
    known = registry.names("disturbance")
    return (*FIRST, *(name for name in known if name not in FIRST))


def standard(component: str) -> Disturbance:
    """Return a component with the strength with which it is added to a tier."""
    return disturbances.strengths(component).get("hard") or registry.get("disturbance", component)()


@cache
def get(name: str) -> Tier:
    """Return the tier that ``name`` describes.

    Raises:
        UnknownNameError: no tier or no component has that name.
        InvalidValueError: a component is added that is there, or removed that is not.
    """
    base, changes = re.split(_SIGN, name, maxsplit=1)[0], _TERM.findall(name)
    if base not in NAMES:
        raise UnknownNameError("tier", base, NAMES, f"Components may be added or removed: {_example()}.")
    there = {component: disturbances.strengths(component) for component in components()}
    tier = plain = Tier(base, {name: strengths[base] for name, strengths in there.items() if base in strengths})
    for sign, term in changes:
        tier = _changed(tier, sign, term)
    return replace(tier, name=_canonical(tier, plain))


def _changed(tier: Tier, sign: str, term: str) -> Tier:
    component, colon, strength = term.partition(":")
    if component not in components():
        raise UnknownNameError("tier component", component, components(), f"For example: {_example()}.")
    wanted, number = None, _number(component, strength) if colon else None
    if sign == "+":
        wanted = standard(component) if number is None else registry.get("disturbance", component).of(number)
    elif colon:
        raise InvalidValueError(f"-{term}: a component is removed whole, without a strength: -{component}.")
    if tier.parts.get(component) == wanted:
        state = "has" if wanted else "has no"
        raise InvalidValueError(
            f"Tier {tier.name!r} {state} {term} anyway; its components: {', '.join(tier.components) or 'none'}."
        )
    return tier.with_part(component, wanted, number)


def _number(component: str, text: str) -> float:
    """Return the strength that is written behind a component."""
    limits = registry.get("disturbance", component).strength
    if limits is None:
        raise InvalidValueError(f"{component} takes no strength: +{component}.")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not limits.least <= number <= limits.most:
        raise InvalidValueError(
            f"{component}:{text} is not possible: its strength is a number from {limits.least:g} to {limits.most:g} "
            f"({limits.meaning})."
        )
    return number


def _canonical(tier: Tier, base: Tier) -> str:
    """Name of a tier: that of its base, then what was added, then what was removed, each in their order."""
    changed = [name for name in components() if tier.parts.get(name) != base.parts.get(name)]
    added = [f"+{name}{_strength(tier, name)}" for name in changed if name in tier.parts]
    removed = [f"-{name}" for name in changed if name not in tier.parts]
    return "".join([base.name, *added, *removed])


def _strength(tier: Tier, name: str) -> str:
    """Write the strength of a component in all its digits, unless it is the standard one."""
    number = tier.strengths.get(name)
    digits = "" if number is None else np.format_float_positional(number, trim="-")
    return "" if number is None or tier.parts[name] == standard(name) else f":{digits}"


def _example() -> str:
    return f"gusts+latency, hard-payload, calm+wind:2 ({', '.join(components())})"

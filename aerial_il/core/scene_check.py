"""Refuse a scene out of a recording that names files or plugins, or that would swell when it is compiled."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from aerial_il.core.errors import InvalidValueError

MAX_BYTES, MAX_ELEMENTS, MAX_CELLS = 8 << 20, 20_000, 16_000_000
SWELLING = ("include", "extension", "plugin", "replicate", "composite", "flexcomp", "frame", "attach", "model", "flex")
COUNTED = ("width", "height", "nrow", "ncol", "gridsize", "nstack", "njmax", "nconmax", "nuser", "nkey", "nuserdata")
OURS = re.compile(r"\s*<(!--|\?xml|mujoco)")


def check_scene(xml: str) -> None:
    """Require that a scene (MJCF) is complete in itself, as compiled scenes are, and of a size that can be held.

    Raises:
        InvalidValueError: it is not.
    """
    if len(xml) > MAX_BYTES or not OURS.match(xml) or "<!DOCTYPE" in xml or "<!ENTITY" in xml:
        raise InvalidValueError(f"it is no MJCF of at most {MAX_BYTES} bytes")
    try:
        elements = list(ElementTree.fromstring(xml).iter())
    except ElementTree.ParseError as error:
        raise InvalidValueError(f"it is not well-formed ({error})") from error
    if len(elements) > MAX_ELEMENTS:
        raise InvalidValueError(f"it has {len(elements)} elements, more than {MAX_ELEMENTS}")
    for element in elements:
        _check_element(element)


def _check_element(element: ElementTree.Element) -> None:
    named = [name for name in element.attrib if name.startswith("file")]
    if element.tag in SWELLING or named:
        raise InvalidValueError(f"<{element.tag}> refers to something outside of it, or stands for many others")
    cells = 1
    for name, value in element.attrib.items():
        if name in COUNTED or name.startswith("nuser"):
            cells *= max(1, _largest(value))
        if name == "memory" and _bytes(value) > MAX_CELLS * 8:
            raise InvalidValueError(f"it asks for {value} of memory")
    if cells > MAX_CELLS:
        raise InvalidValueError(f"<{element.tag}> asks for {cells} cells, more than {MAX_CELLS}")


def _largest(value: str) -> int:
    return max((int(number) for number in re.findall(r"\d{1,18}", value)), default=0)


def _bytes(value: str) -> int:
    return _largest(value) << {"K": 10, "M": 20, "G": 30, "T": 40}.get(value.strip()[-1:].upper(), 0)

"""The XML of a model file, read so that a file from anybody can do no harm."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from aerial_il.robots.parts.described.error import ModelFileError

MAX_BYTES, MAX_ELEMENTS, MAX_DEPTH = 8 << 20, 20_000, 100


def read_tree(path: Path) -> Element:
    """Return the root element of an XML file.

    Entities are refused before anything is parsed, whatever their size: no model needs one.

    Raises:
        ModelFileError: not a file, too large, not UTF-8, with a document type, malformed, or nested too deeply.
    """
    if not path.is_file():
        raise ModelFileError(path, "there is no such file. A model file lies beside the robot's own file.")
    if path.stat().st_size > MAX_BYTES:
        raise ModelFileError(path, f"it has {path.stat().st_size} bytes, and {MAX_BYTES} is the most that is read.")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelFileError(path, f"it cannot be read as UTF-8 text ({error}).") from error
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ModelFileError(path, "it declares a document type or entities, which are not read. Remove them.")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ModelFileError(path, f"it is not well-formed XML ({error}).") from error
    _check_size(root, path)
    return root


def _check_size(root: Element, path: Path) -> None:
    """Refuse what would swell, or overflow the stack of who reads it next."""
    count, level, depth = 0, [root], 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > MAX_ELEMENTS or depth > MAX_DEPTH:
            limits = f"{MAX_ELEMENTS} elements, {MAX_DEPTH} within one another"
            raise ModelFileError(path, f"it has more elements than are read: at most {limits}.")
        level = [child for element in level for child in element]


def remove(root: Element, unwanted: tuple[str, ...]) -> None:
    """Remove all elements of these names, at any depth."""
    for parent in list(root.iter()):
        for child in [child for child in parent if child.tag in unwanted]:
            parent.remove(child)

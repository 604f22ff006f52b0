"""The XML of a model file, read so that a file from anybody can do no harm."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.xml_tree import MAX_BYTES, parse_xml
from aerial_il.robots.parts.described.error import ModelFileError


def read_tree(path: Path) -> Element:
    """Return the root element of an XML file, without what is named by a prefix, as tools of others leave notes.

    Raises:
        ModelFileError: not a file, too large, not UTF-8, with a document type, malformed, or nested too deeply.
    """
    if not path.is_file():
        raise ModelFileError(path, "there is no such file. A model file lies beside the robot's own file.")
    if path.stat().st_size > MAX_BYTES:
        raise ModelFileError(path, f"it has {path.stat().st_size} bytes, and {MAX_BYTES} is the most that is read.")
    try:
        root = parse_xml(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ModelFileError(path, f"it cannot be read as UTF-8 text ({error}).") from error
    except InvalidValueError as error:
        raise ModelFileError(path, f"{error}.") from error
    foreign = {element.tag for element in root.iter() if ":" in element.tag and not element.tag.startswith("xacro:")}
    remove(root, tuple(foreign))
    return root


def remove(root: Element, unwanted: tuple[str, ...]) -> None:
    """Remove all elements of these names, at any depth."""
    for parent in list(root.iter()):
        for child in [child for child in parent if child.tag in unwanted]:
            parent.remove(child)

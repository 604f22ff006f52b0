"""Parse XML that somebody else wrote: no entities, no namespaces, no more elements than can be held."""

from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from aerial_il.core.errors import InvalidValueError

MAX_BYTES, MAX_ELEMENTS, MAX_DEPTH = 8 << 20, 20_000, 100


def parse_xml(text: str) -> Element:
    """Return the root element; tags and attributes are named as they are written, ``prefix:name`` with their prefix.

    MuJoCo reads names so, too: with namespaces resolved, what is checked would not be what it reads.

    Raises:
        InvalidValueError: it is no XML, has a document type, or more than ``MAX_BYTES``, ``MAX_ELEMENTS`` or
            ``MAX_DEPTH``.
    """
    raw = text.encode()
    if len(raw) > MAX_BYTES:
        raise InvalidValueError(f"it has {len(raw)} bytes, and {MAX_BYTES} is the most that is read")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InvalidValueError("it declares a document type or entities, which are not read; remove them")
    builder, parser = _Bounded(), expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(raw, True)
    except expat.ExpatError as error:
        raise InvalidValueError(f"it is not well-formed XML ({error})") from error
    return builder.close()


class _Bounded(TreeBuilder):
    """Builds a tree until it has too many elements."""

    def __init__(self) -> None:
        super().__init__()
        self._count = self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:  # type: ignore[override]
        self._count, self._depth = self._count + 1, self._depth + 1
        if self._count > MAX_ELEMENTS or self._depth > MAX_DEPTH:
            limits = f"at most {MAX_ELEMENTS} elements, {MAX_DEPTH} within one another"
            raise InvalidValueError(f"it has more elements than are read: {limits}")
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)

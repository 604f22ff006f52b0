"""Libraries that only some launchers and searches need, and how to get them."""

from importlib.util import find_spec

from aerial_il.core.errors import InvalidValueError


def require(library: str, *, extra: str) -> None:
    """Refuse to go on without ``library``, naming the extra of this package that brings it."""
    if find_spec(library) is None:
        raise InvalidValueError(f"{library} is not installed. Install it: pip install 'aerial-il[{extra}]'")
